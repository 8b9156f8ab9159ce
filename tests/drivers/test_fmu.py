"""The driver `fmu` against a C source of its own (fmu_tank.c, FMI 2.0 and 3.0) and models of PythonFMU."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest

from helpers.fmus import PYTHON_TANK, python_fmu, tank_fmu
from helpers.tiers import first
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, check, connect
from umo.drivers import ChannelError, ChannelsFailed, Direction, DriverError, WiringError
from umo.drivers.fmu import Fmu
from umo.drivers.fmu.variables import variables_of
from umo.errors import StopError
from umo.states import OnOff
from umo.testing import periods


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fmus")


@pytest.fixture(params=[2, 3], ids=["fmi2", "fmi3"])
def version(request: pytest.FixtureRequest) -> int:
    return int(request.param)


@pytest.fixture
def unpacked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """The folder in which FMUs are unpacked."""
    own = tmp_path / "unpacked"
    own.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(own))
    return own


@pytest.fixture
def tank(folder: Path, version: int, unpacked: Path):
    """The tank, open, with a period of 100 ms."""
    driver = Fmu(model=tank_fmu(folder, version))
    driver.period = 0.1
    driver.open()
    yield driver
    driver.close()


def write(driver: Fmu, **raws: int) -> None:
    """By name; `inflow` in thousandths."""
    texts = [name + ":0.001" * (name in ("inflow", "gain", "single")) for name in raws]
    driver.write_many([driver.channel(text) for text in texts], np.array(list(raws.values())))


def read(driver: Fmu, *texts: str) -> list[int]:
    out = np.full(len(texts), -99, np.int64)
    driver.read_many([driver.channel(text) for text in texts], out)
    return out.tolist()


def tick(driver: Fmu, count: int = 1) -> None:
    timer = driver.channel("tick")
    for _ in range(count):
        assert driver.read(timer) == 0


# Channels -------------------------------------------------------------------------------------------


def test_the_variables_of_the_model_are_channels(tank):
    for text, direction, bits, signed in [
        ("inflow:0.001", Direction.OUTPUT, 48, True),
        ("gain:1e-6", Direction.OUTPUT, 48, True),
        ("tank.level:-0.5", Direction.INPUT, 48, True),
        ("time:0.001", Direction.INPUT, 48, True),
        ("count", Direction.OUTPUT, 32, True),
        ("enable", Direction.OUTPUT, 1, False),
        ("tick", Direction.INPUT, 31, False),
    ]:
        channel = tank.channel(text)
        assert (channel.text, channel.direction, channel.bits, channel.signed) == (text, direction, bits, signed)


@pytest.mark.parametrize(
    ("text", "bits", "signed"),
    [
        ("small", 8, True),
        ("word", 16, False),
        ("wide", 64, True),
        ("big", 63, False),
        ("mode", 64, True),
        ("single:1", 48, True),
    ],
)
def test_the_types_of_fmi_3_have_their_widths(folder, text, bits, signed):
    channel = Fmu(model=tank_fmu(folder, 3)).channel(text)
    assert (channel.bits, channel.signed) == (bits, signed)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("tank.levle:0.1", "did you mean 'tank.level:SCALE'"),
        ("tank.level", "the forms are: tank.level:SCALE"),
        ("tank.level:0", "the forms are: tank.level:SCALE"),
        ("tank.level:nan", "the forms are: tank.level:SCALE"),
        ("count:2", "the forms are: count"),
        ("", "[0-9]+ others, tick"),
    ],
)
def test_another_text_is_answered_with_the_nearest_variables(tank, text, message):
    with pytest.raises(ChannelError, match=message):
        tank.channel(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("label", "label is a String; umo takes floats, integers, booleans and enumerations"),
        ("time_constant:1", "is a fixed parameter: give it in start_values"),
    ],
)
def test_a_variable_that_cannot_be_a_channel_says_why(tank, text, message):
    with pytest.raises(WiringError, match=message):
        tank.channel(text)


@pytest.mark.parametrize("text", ["rows_out:1", "rows_out[3,1]:1", "rows_out[2]:1", "rows_out[1,1,1]:1"])
def test_an_array_is_named_by_its_elements(folder, text):
    driver = Fmu(model=tank_fmu(folder, 3))
    with pytest.raises(WiringError, match=r"rows_out is an array: its elements are rows_out\[1,1\] to rows_out\[2,3\]"):
        driver.channel(text)
    for wrong in ("rows_out[0,1]:1", "rows_out[1,1]", "count[1]", "rows_out[]:1"):
        with pytest.raises((ChannelError, WiringError)):
            driver.channel(wrong)
    with pytest.raises(WiringError, match="rows is an array"):
        Fmu(model=tank_fmu(folder, 3), start_values={"rows": 1.0})


def test_elements_of_arrays_are_read_and_written_and_the_others_stay(folder, unpacked):
    driver = Fmu(model=tank_fmu(folder, 3))
    driver.open()
    texts = ["rows_out[2,3]:0.5", "tank.level:1", "rows_out[1,2]:0.5", "rows_out[1,1]:0.5", "steps"]
    assert read(driver, *texts) == [11, 0, 3, 1, 0]

    def put(raws):
        driver.write_many([driver.channel(text) for text in raws], np.array(list(raws.values())))

    put({"rows[2,3]:1": 10, "inflow:0.001": 5, "rows[1,2]:1": 20})
    put({"rows[1,1]:1": 30})
    driver.write(driver.channel("rows[2,1]:1"), 40)
    assert driver.report()["rows_out"] == [[30.5, 21.5, 2.5], [43.5, 4.5, 15.5]]
    assert read(driver, *texts)[0] == 31
    assert driver.channel("rows[1,1]:1").places != driver.channel("rows[1,2]:1").places
    assert driver.channel("rows[1,1]:1").direction is Direction.OUTPUT
    driver.close()


def test_one_variable_is_one_place_whatever_its_scale(tank):
    assert tank.channel("tank.level:1").places == tank.channel("tank.level:0.1").places
    assert tank.channel("tank.level:1").places != tank.channel("odd:1").places


def test_a_variable_called_like_a_channel_with_a_scale_is_found_by_its_whole_name(folder):
    extra = (
        '<ScalarVariable name="\'level:0.1\'" valueReference="5" causality="local" variability="discrete"><Integer/>'
        "</ScalarVariable>"
    )
    driver = Fmu(model=tank_fmu(folder, 2, extra=extra))
    assert driver.channel("'level:0.1'").reference == 5


# Options --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"lable": "x"}, "the model has no variable 'lable'; it has: label"),
        ({"label": 1}, "label takes a text, not 1"),
        ({"count": 2.0}, "count takes a whole number from -2147483648 to 2147483647, not 2.0"),
        ({"count": 2**31}, "count takes a whole number"),
        ({"count": True}, "count takes a whole number"),
        ({"enable": 1}, "enable takes true or false, not 1"),
        ({"gain": math.nan}, "gain takes a finite number, not nan"),
        ({"gain": "2"}, "gain takes a finite number, not '2'"),
        ({"doubled": 1}, "doubled cannot be set, its causality is output"),
    ],
)
def test_start_values_are_checked_before_the_model_is_opened(folder, version, values, message):
    with pytest.raises(WiringError, match=message):
        Fmu(model=tank_fmu(folder, version), start_values=values)


@pytest.mark.parametrize("substeps", [0, -1, 1.5, True])
def test_substeps_are_a_whole_number_from_1(folder, substeps):
    with pytest.raises(WiringError, match="substeps must be a whole number from 1 to 1000000"):
        Fmu(model=tank_fmu(folder, 2), substeps=substeps)


def test_a_file_that_is_not_there_or_not_an_fmu_is_named(tmp_path):
    with pytest.raises(WiringError, match=r"model: .*none\.fmu: No such file or directory"):
        Fmu(model=tmp_path / "none.fmu")
    with pytest.raises(WiringError, match=r"is a folder, not an \.fmu file"):
        Fmu(model=tmp_path)
    text, empty, wrong = tmp_path / "text.fmu", tmp_path / "empty.fmu", tmp_path / "wrong.fmu"
    text.write_text("not a zip")
    with pytest.raises(WiringError, match="cannot be read as an FMU: it is not a zip archive"):
        Fmu(model=text)
    zipfile.ZipFile(empty, "w").close()
    with pytest.raises(WiringError, match=r"cannot be read as an FMU: .*modelDescription\.xml"):
        Fmu(model=empty)
    with zipfile.ZipFile(wrong, "w") as archive:
        archive.writestr("modelDescription.xml", "<somethingElse/>")
    with pytest.raises(WiringError, match=r"cannot be read as an FMU: .*; try fmpy validate") as error:
        Fmu(model=wrong)
    assert "\n" not in str(error.value)


def test_a_unit_for_model_exchange_is_refused(folder, tmp_path):
    file = tmp_path / "exchange.fmu"
    with zipfile.ZipFile(tank_fmu(folder, 2)) as archive:
        text = archive.read("modelDescription.xml").decode()
    text = text.replace("<CoSimulation", "<ModelExchange")
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("modelDescription.xml", text)
    with pytest.raises(WiringError, match="is not for co-simulation"):
        Fmu(model=file)


def test_without_fmpy_one_line_names_the_extra(folder, monkeypatch, tmp_path):
    import shutil

    file = shutil.copy(tank_fmu(folder, 2), tmp_path / "fresh.fmu")
    for name in [name for name in sys.modules if name.partition(".")[0] == "fmpy"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "fmpy", None)
    with pytest.raises(DriverError, match=r'the fmu driver needs FMPy: pip install "\.\[fmu\]" in the clone of umo'):
        Fmu(model=Path(file))


def test_the_class_is_found_without_importing_fmpy():
    code = "import sys; from umo.drivers import registry; import umo.drivers.fmu; assert 'fmpy' not in sys.modules"
    assert os.spawnv(os.P_WAIT, sys.executable, [sys.executable, "-c", code]) == 0


# The model ------------------------------------------------------------------------------------------


def test_the_level_follows_the_analytic_solution(tank):
    write(tank, inflow=4000, enable=1)
    for n in range(1, 51):
        tick(tank)
        assert read(tank, "tank.level:1e-9") == [round(4e9 * (1 - math.exp(-0.1 * n / 2.0)))]


@pytest.mark.parametrize("substeps", [1, 7])
def test_time_does_not_drift_from_the_grid_of_periods(folder, version, substeps, unpacked):
    driver = Fmu(model=tank_fmu(folder, version), substeps=substeps)
    driver.period = 0.1
    driver.open()
    tick(driver, 1000)
    assert read(driver, "steps", "time:1e-9") == [1000 * substeps, 100_000_000_000]
    driver.close()


def test_start_values_hold_from_the_beginning(folder, version, unpacked):
    values = {"tank.level": 3, "time_constant": 0.5, "gain": 2.0, "count": 4, "enable": True, "mode": 2, "label": "x"}
    driver = Fmu(model=tank_fmu(folder, version), start_values=values)
    driver.period = 0.1
    driver.open()
    assert read(driver, "tank.level:0.001", "doubled", "enabled", "mode_used") == [3000, 8, 1, 2]
    tick(driver)
    assert read(driver, "tank.level:1e-9") == [round(3e9 * math.exp(-0.1 / 0.5))]
    driver.close()


def test_a_tunable_parameter_is_an_output(tank):
    write(tank, inflow=1000, enable=1, gain=2500)
    tick(tank, 1000)
    assert read(tank, "tank.level:1e-6") == [2_500_000]


def test_the_integers_of_fmi_3_keep_their_ends(folder, unpacked):
    driver = Fmu(model=tank_fmu(folder, 3))
    driver.open()
    for ends in ((-128, 0, -(2**63), 0), (127, 2**63 - 1, 2**63 - 1, 65535)):
        write(driver, **dict(zip(("small", "big", "wide", "word"), ends, strict=True)))
        assert read(driver, "small_out", "big_out", "wide_out", "word_out") == list(ends)
    write(driver, single=-1250)
    assert read(driver, "single_out:0.001") == [-1250]
    driver.close()


def test_single_transfers_equal_those_of_a_block(tank):
    for text, raw in (("inflow:0.001", -5), ("count", 11), ("enable", 1), ("mode", 2)):
        tank.write(tank.channel(text), raw)
    tick(tank)
    texts = ("tank.level:1e-9", "doubled", "enabled", "mode_used", "steps")
    assert [tank.read(tank.channel(text)) for text in texts] == read(tank, *texts)


def test_opening_again_begins_at_the_start(tank):
    write(tank, inflow=1000, enable=1)
    tick(tank, 3)
    tank.close()
    tank.open()
    assert read(tank, "tank.level:0.001", "steps", "enabled", "time:0.1") == [0, 0, 0, 0]


def test_two_instances_of_one_file_do_not_disturb_each_other(folder, version, unpacked):
    one, other = (Fmu(model=tank_fmu(folder, version)) for _ in range(2))
    for driver in (one, other):
        driver.period = 0.1
        driver.open()
    write(one, count=1)
    write(other, count=2, fault=3)
    with pytest.raises(DriverError, match=r"the pump ran dry at 0\.0 s"):
        tick(other)
    tick(one)
    assert read(one, "doubled", "steps") == [2, 1]
    one.close()
    other.close()


def test_the_report_gives_the_time_and_the_outputs_in_the_units_of_the_model(tank):
    write(tank, count=3, enable=1, inflow=1000)
    tick(tank, 20)
    report = tank.report()
    assert report["time_s"] == 2.0
    assert report["tank.level"] == pytest.approx(1 - math.exp(-1))
    assert (report["doubled"], report["enabled"], report["steps"]) == (6, True, 20)
    assert "inflow" not in report
    write(tank, count=13)
    assert tank.report()["odd"] is None


# Errors ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("count", "given"), [(13, "nan"), (14, "inf"), (15, "1e\\+300")])
def test_a_value_that_is_not_a_raw_integer_fails_for_its_channel_alone(tank, count, given):
    write(tank, count=count, mode=2)
    channels = [tank.channel(text) for text in ("mode_used", "odd:0.01", "tank.level:1", "doubled")]
    out = np.full(4, -99, np.int64)
    with pytest.raises(ChannelsFailed, match=f"^odd:0.01: the model gives {given}$") as error:
        tank.read_many(channels, out)
    assert set(error.value.causes) == {"odd:0.01"}
    assert out.tolist() == [2, -99, 0, 2 * count]


@pytest.mark.parametrize(("text", "raw"), [("count", 2**31), ("count", -(2**31) - 1), ("enable", 2), ("enable", -1),
                                           ("inflow:0.001", 2**47)])  # fmt: skip
def test_a_raw_that_does_not_fit_changes_nothing(tank, text, raw):
    with pytest.raises(DriverError, match=f"{raw} does not fit {text}: it takes"):
        tank.write(tank.channel(text), raw)
    with pytest.raises(DriverError, match=f"{raw} does not fit {text}: it takes"):
        tank.write_many([tank.channel("mode"), tank.channel(text)], np.array([2, raw]))
    assert read(tank, "doubled", "enabled", "mode_used") == [0, 0, 1]


def test_a_value_that_the_model_refuses_fails_with_its_message_and_the_model_goes_on(tank):
    with pytest.raises(ChannelsFailed, match=r"inflow:1000: .* discard: an inflow of 2e\+06 is too large") as error:
        tank.write_many([tank.channel("inflow:1000"), tank.channel("count")], np.array([2000, 4]))
    assert set(error.value.causes) == {"inflow:1000"}
    tick(tank)
    assert read(tank, "steps", "doubled") == [1, 8]


def test_a_value_that_the_model_cannot_give_fails_and_the_model_goes_on(tank):
    write(tank, count=16)
    with pytest.raises(ChannelsFailed, match="discard"):
        read(tank, "odd:1", "doubled")
    tick(tank)
    assert read(tank, "steps") == [1]


@pytest.mark.parametrize(("fault", "status"), [(2, "discard"), (3, "error"), (4, "fatal")])
def test_a_step_that_fails_has_the_message_of_the_model_and_no_call_follows(tank, unpacked, fault, status, capfd):
    tick(tank, 2)
    write(tank, fault=fault)
    message = f"fmi.DoStep at 0.2 s: {status}: the pump ran dry at 0.2 s$"
    with pytest.raises(DriverError, match=message):
        tick(tank)
    for call in (lambda: tick(tank), lambda: read(tank, "steps"), lambda: write(tank, count=1)):
        with pytest.raises(DriverError, match=message):
            call()
    report = tank.report()
    assert report.pop("time_s") == 0.2
    assert report
    assert all(re.search(message, str(each)) for each in report.values()), report
    tank.close()
    assert list(unpacked.iterdir()) == []
    tank.open()
    tick(tank)
    assert read(tank, "steps") == [1]
    assert capfd.readouterr() == ("", "")


def test_an_error_while_reading_loses_the_model(tank):
    write(tank, count=17)
    with pytest.raises(DriverError, match=r"fmi.Get.* at 0 s: error"):
        read(tank, "doubled", "odd:1")
    with pytest.raises(DriverError, match=r"fmi.Get.* at 0 s: error"):
        tick(tank)


def test_a_model_that_ends_its_simulation_says_when_and_still_has_its_last_values(tank, version):
    """FMI 2.0 (4.2.3): a discarded step, and fmi2Terminated; FMI 3.0: terminateSimulation."""
    write(tank, inflow=1000, enable=1)
    tick(tank, 2)
    write(tank, fault=9)
    at, why = ("0.25", ": the tank is full, .*") if version == 2 else ("0.3", "")
    for _ in range(2):
        with pytest.raises(DriverError, match=rf"^the model has ended its simulation at {at} s{why}$"):
            tick(tank)
    report = tank.report()
    assert report["time_s"] == float(at)
    assert report["tank.level"] > 0
    with pytest.raises(DriverError, match="has ended its simulation"):
        write(tank, inflow=5)
    tank.reset(tank.channel("inflow:0.001"), 0)


def test_the_report_has_outputs_of_every_type(tank, version):
    report = tank.report()
    assert report["text_out"] == "höhe \N{REPLACEMENT CHARACTER}"
    if version == 3:
        assert report["data_out"] == "de ad be ef"
        assert report["rows_out"] == [[0.5, 1.5, 2.5], [3.5, 4.5, 5.5]]
        assert (report["byte_out"], report["dword_out"], report["single_out"]) == (0, 0, 0.0)
    assert set(report) == {"time_s"} | {
        name for name, each in variables_of(tank._description).items() if each.causality == "output"
    }


def test_an_output_that_the_model_does_not_give_says_so_in_the_report_and_the_others_are_there(tank):
    write(tank, count=16)  # "odd" is discarded
    report = tank.report()
    assert "discard" in report["odd"]
    assert report["steps"] == 0


def test_directions_are_kept(tank):
    with pytest.raises(DriverError, match="count is an output"):
        tank.read(tank.channel("count"))
    with pytest.raises(DriverError, match="steps is an input"):
        tank.write(tank.channel("steps"), 1)
    with pytest.raises(DriverError, match="tick is an input"):
        tank.write(tank.channel("tick"), 1)


def test_a_driver_that_is_not_open_says_so(folder):
    driver = Fmu(model=tank_fmu(folder, 2))
    driver.period = 0.1
    for call in (lambda: tick(driver), lambda: read(driver, "steps"), lambda: write(driver, count=1), driver.report):
        with pytest.raises(DriverError, match="it is not open"):
            call()
    driver.close()


def test_a_timer_without_a_period_says_so(tank):
    tank.period = 0.0
    with pytest.raises(DriverError, match="the period is 0 s"):
        tick(tank)


def test_a_fixed_step_of_the_model_that_does_not_divide_the_period_is_refused(folder, unpacked):
    file = tank_fmu(folder, 3, attributes='fixedInternalStepSize="0.04"')
    driver = Fmu(model=file)
    driver.period = 0.1
    with pytest.raises(DriverError, match=r"multiples of 40 ms; the period with its substeps is 100 ms"):
        driver.open()
    driver.close()
    driver.period = 0.12
    driver.open()
    driver.close()
    assert list(unpacked.iterdir()) == []


# Opening and closing --------------------------------------------------------------------------------


def test_the_folder_lives_from_open_to_close(tank, unpacked):
    assert len(list(unpacked.iterdir())) == 1
    tank.close()
    assert list(unpacked.iterdir()) == []
    tank.close()


def test_a_wrong_model_identifier_is_told_as_such(folder, version, tmp_path):
    renamed = tmp_path / "renamed.fmu"
    with zipfile.ZipFile(tank_fmu(folder, version)) as archive, zipfile.ZipFile(renamed, "w") as copy:
        for name in archive.namelist():
            copy.writestr(name, archive.read(name).replace(b'modelIdentifier="tank"', b'modelIdentifier="Tank_1"'))
    words = r"renamed\.fmu: its modelIdentifier is 'Tank_1', but its code for \S+ is tank\.so$"
    with pytest.raises(DriverError, match=words):
        Fmu(model=renamed).open()


def test_every_channel_that_is_listed_is_taken(folder, version, umo):
    driver = Fmu(model=tank_fmu(folder, version))
    with pytest.raises(ChannelError) as error:
        driver.channel("?")
    listed = str(error.value).partition("the forms are: ")[2].split(", ")
    for text in listed:
        driver.channel(text.replace("SCALE", "0.001"))
    assert {"inflow:SCALE", "doubled", "gain:SCALE", "tick"} < set(listed)
    assert not {"time_constant:SCALE", "label"} & set(listed), "a fixed parameter, a text"
    with pytest.raises(ChannelError) as error:
        driver.channel("time_constan:0.1")
    assert "time_constant" not in str(error.value).partition("the forms are: ")[2]


def test_an_fmu_without_code_for_this_platform_names_those_that_it_has(folder, version, unpacked):
    driver = Fmu(model=tank_fmu(folder, version, platform="win99"))
    with pytest.raises(DriverError, match=r"tank.win99\.fmu has no code for \S+; it has: win99$"):
        driver.open()
    driver.close()
    assert list(unpacked.iterdir()) == []


def test_a_library_that_cannot_be_loaded_leaves_nothing_behind(folder, version, unpacked, tmp_path):
    file, here = tmp_path / "broken.fmu", os.getcwd()
    with zipfile.ZipFile(tank_fmu(folder, version)) as whole, zipfile.ZipFile(file, "w") as archive:
        for name in whole.namelist():
            archive.writestr(name, b"not a library" if name.startswith("binaries") else whole.read(name))
    driver = Fmu(model=file)
    with pytest.raises(DriverError, match=r"broken\.fmu cannot be loaded: ") as error:
        driver.open()
    assert "\n" not in str(error.value)
    assert os.getcwd() == here
    assert list(unpacked.iterdir()) == []


def test_a_model_that_cannot_be_instantiated_or_initialised_leaves_nothing_behind(folder, version, unpacked, tmp_path):
    file = tmp_path / "other.fmu"
    with zipfile.ZipFile(tank_fmu(folder, version)) as whole, zipfile.ZipFile(file, "w") as archive:
        for name in whole.namelist():
            archive.writestr(name, whole.read(name).replace(b'guid="{tank}"', b'guid="{tub}"').replace(
                b'Token="{tank}"', b'Token="{tub}"') if name.endswith(".xml") else whole.read(name))  # fmt: skip
    with pytest.raises(DriverError, match=r"could not be instantiated: the (guid|token) is another one, 0"):
        Fmu(model=file).open()
    with pytest.raises(DriverError, match=r"EnterInitializationMode at 0 s: error: a time constant of -1 s"):
        Fmu(model=tank_fmu(folder, version), start_values={"time_constant": -1.0}).open()
    assert list(unpacked.iterdir()) == []


def test_opening_and_closing_leaks_neither_files_nor_libraries(folder, version, unpacked):
    driver = Fmu(model=tank_fmu(folder, version))
    driver.open()
    driver.close()
    before = len(os.listdir("/proc/self/fd")) if sys.platform == "linux" else 0
    for _ in range(10):
        driver.open()
        driver.close()
    if sys.platform == "linux":
        assert len(os.listdir("/proc/self/fd")) == before
        assert str(unpacked) not in Path("/proc/self/maps").read_text()
    assert list(unpacked.iterdir()) == []


# PythonFMU ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def python_tank(folder: Path) -> Path:
    return python_fmu(folder, PYTHON_TANK, "python_tank_of_the_tests")


@pytest.mark.full
@pytest.mark.skipif(shutil.which("valgrind") is None, reason="needs valgrind")
def test_a_library_of_pythonfmu_that_stays_loaded_frees_nothing_twice_when_the_process_ends(python_tank, tmp_path):
    code = f"from umo.drivers.fmu import Fmu; d = Fmu(model={str(python_tank)!r}); d.open(); d.close()"
    log = tmp_path / "valgrind"
    words = ["valgrind", "--quiet", f"--log-file={log}", sys.executable, "-c", code]
    subprocess.run(words, check=True, env=os.environ | {"PYTHONMALLOC": "malloc"})
    assert f"(in {tempfile.gettempdir()}/umo-fmu-" not in log.read_text()


def test_a_model_of_pythonfmu_follows_its_difference_equation(python_tank, unpacked):
    driver = Fmu(model=python_tank, start_values={"time_constant": 0.5}, substeps=2)
    driver.period = 0.1
    driver.open()
    driver.write_many([driver.channel("inflow:0.001"), driver.channel("open")], np.array([2000, 1]))
    level = 0.0
    for n in range(1, 21):
        tick(driver)
        level += 0.05 * (2.0 - level) / 0.5
        level += 0.05 * (2.0 - level) / 0.5
        assert read(driver, "level:1e-9", "steps") == [round(level * 1e9), 2 * n]
    driver.close()
    assert list(unpacked.iterdir()) == []


def test_an_exception_in_a_model_of_pythonfmu_is_an_error_with_its_text(python_tank, unpacked):
    driver = Fmu(model=python_tank)
    driver.period = 0.1
    driver.open()
    driver.write_many([driver.channel("inflow:0.001"), driver.channel("open")], np.array([100_000, 1]))
    tick(driver)
    try:
        with pytest.raises(DriverError, match=r"fmi2DoStep at 0.1 s: fatal: .*the tank overflows"):
            tick(driver)
    finally:
        driver.close()


# In a wiring ----------------------------------------------------------------------------------------


class Machine(Compound):
    inflow: DigitalActuator
    valve: BinaryActuator[OnOff]
    level: DigitalSensor
    timer: DigitalSensor


def machine() -> Machine:
    return Machine(
        inflow=DigitalActuator("m^3/h", default=0.0, minimum=0.0, maximum=10.0, resolution=0.001),
        valve=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
        level=DigitalSensor("m", minimum=0.0, maximum=10.0, resolution=0.001),
        timer=DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.0, resolution=1.0, synchronous=False),
    )


WIRING = """
[drivers.plant]
type = "fmu"
model = "{model}"
start_values = {{ "tank.level" = 1.0, count = 3, enable = true, label = "of the test" }}

[wire]
"inflow" = {{ driver = "plant", channel = "inflow:0.001" }}
"valve" = {{ driver = "plant", channel = "enable" }}
"level" = {{ driver = "plant", channel = "{level}" }}
"timer" = {{ driver = "plant", channel = "tick", period = "100 ms" }}
"""


def wiring(model: Path | str, level: str = "tank.level:0.001") -> str:
    return WIRING.format(model=model, level=level)


@pytest.mark.parametrize("ends", first(1, [False, True]))
def test_a_run_on_a_model_with_outputs_of_every_type_ends_well_and_has_its_report(
    folder, version, unpacked, umo, tmp_path, ends
):
    """A run that the model ends has failed, and its report has the last values."""
    model = tank_fmu(folder, version)
    (tmp_path / "wiring").mkdir()
    (tmp_path / "objects.py").write_text(
        "from umo import Compound, DigitalActuator, DigitalSensor\n\n\nclass Tank(Compound):\n"
        "    fault: DigitalActuator\n    timer: DigitalSensor\n\n\ndef machine():\n"
        "    return Tank(fault=DigitalActuator('count', default=0.0, minimum=0.0, maximum=9.0, resolution=1.0),\n"
        "        timer=DigitalSensor('sampling_period', minimum=0, maximum=9, resolution=1, synchronous=False))\n"
    )
    (tmp_path / "application.py").write_text(
        f"from umo.control import wait\n\n\nasync def main(m):\n    await wait(0.5)\n    m.fault.write({9 * ends})\n"
        "    await wait(0.5)\n"
    )
    (tmp_path / "wiring" / "simulated.toml").write_text(
        f'[drivers.tank]\ntype = "fmu"\nmodel = "{model}"\n[wire]\n"fault" = {{ driver = "tank" }}\n'
        '"timer" = { driver = "tank", channel = "tick", period = "100 ms" }\n'
    )
    result = umo("run", ".", "--summary", "sum.json", "--no-plot")
    text = " ".join(result.output.split())
    assert result.exit_code == ends, text
    assert ("the model has ended its simulation at" in text) is ends
    report = json.loads((tmp_path / "sum.json").read_text())["reports"]["tank"]
    assert report["text_out"] == "höhe \N{REPLACEMENT CHARACTER}"
    assert report["steps"] > 4


def test_a_machine_runs_in_virtual_time_on_the_model(folder, version, unpacked):
    with connect(machine(), tomllib.loads(wiring(tank_fmu(folder, version)))) as m:
        assert m.level.read() == pytest.approx(1.0)
        m.inflow.write(5.0)
        m.valve.write(OnOff.ON)
        periods(m, 21)  # the commands of the first period act from the second on
        assert m.level.read() == pytest.approx(5.0 - 4.0 * math.exp(-1.0) * math.exp(-0.05) / math.exp(-0.05), abs=0.1)
    assert list(unpacked.iterdir()) == []


def test_a_relative_path_in_a_wiring_starts_from_the_station(folder, tmp_path, monkeypatch):
    station = tmp_path / "station"
    (station / "wiring").mkdir(parents=True)
    (station / "objects.py").write_text("")
    model = tank_fmu(folder, 2)
    (station / "tank.fmu").write_bytes(model.read_bytes())
    (station / "wiring" / "simulated.toml").write_text(wiring("tank.fmu"))
    monkeypatch.chdir(tmp_path)
    assert check(machine(), Path("station/wiring/simulated.toml")) == []
    assert check(machine(), station / "wiring" / "simulated.toml") == []
    (tmp_path / "alone.toml").write_text(wiring("station/tank.fmu"))
    monkeypatch.chdir(station)
    assert check(machine(), tmp_path / "alone.toml") == []


def test_a_check_of_the_wiring_names_the_nearest_variable_and_opens_nothing(folder, unpacked):
    faults = check(machine(), tomllib.loads(wiring(tank_fmu(folder, 2), "tank.lvl:0.001")))
    assert [fault.key for fault in faults] == ['wire."level".channel']
    assert "did you mean 'tank.level:SCALE'" in faults[0].message
    assert list(unpacked.iterdir()) == []


def test_a_model_beside_another_timer_would_stand_still(folder):
    given = tomllib.loads(wiring(tank_fmu(folder, 2)))
    given["wire"]["timer"] = {"driver": "timerfd", "period": "100 ms"}
    [fault] = check(machine(), given)
    assert fault.key == 'wire."timer".driver'
    assert "timerfd is the timer, so no time would pass in driver plant" in fault.message


FLOW = """<ScalarVariable name="flow" valueReference="1" causality="input"><Real {unit}/></ScalarVariable>"""


@pytest.mark.parametrize(
    ("unit", "scale"),
    [
        ('unit="m3/s"', "0.001"),  # the object has m^3/h
        ('unit="m3/h"', "0.01"),
        ('unit="l/h"', "0.001"),
    ],
)
def test_a_scale_that_differs_from_the_object_in_the_unit_of_the_model_is_a_fault(folder, unit, scale):
    wired = wiring(tank_fmu(folder, 2, extra=FLOW.format(unit=unit))).replace("inflow:0.001", f"flow:{scale}")
    [fault] = check(machine(), tomllib.loads(wired))
    assert fault.key == 'wire."inflow"'
    assert "away from the scale of the circuit, channel flow" in fault.message


@pytest.mark.parametrize(
    ("unit", "scale"),
    [
        ('unit="m3/h"', "0.001"),
        ('unit="l/h"', "1"),
        ('unit="kg/s"', "0.1"),  # of another dimension
        ('unit="furlongs of mine"', "0.1"),
        ('unit="9**9**9 m3/h"', "0.1"),
        ("", "0.1"),
    ],
)
def test_a_scale_that_fits_or_cannot_be_compared_passes(folder, unit, scale):
    wired = wiring(tank_fmu(folder, 2, extra=FLOW.format(unit=unit))).replace("inflow:0.001", f"flow:{scale}")
    assert check(machine(), tomllib.loads(wired)) == []


@pytest.mark.parametrize(
    ("unit", "given"),
    [("degC", "degC"), ("K", "K"), ("N.m", "N*m"), ("kg/(m.s2)", "kg/(m*s**2)"), ("m-1", "m**-1"), ("W/m^2", "W/m**2")],
)
def test_a_unit_of_a_model_is_given_as_pint_writes_it(folder, unit, given):
    driver = Fmu(model=tank_fmu(folder, 2, extra=FLOW.format(unit=f'unit="{unit}"')))
    assert driver.physical_scale(driver.channel("flow:0.5")) == (0.5, 0.0, given)
    assert driver.physical_scale(driver.channel("steps")) is None


def test_a_failed_step_ends_the_run_with_the_message_of_the_model_alone(folder, version, unpacked):
    """Nothing is reported as not reset: a model that has failed has no levels."""
    connection = connect(machine(), tomllib.loads(wiring(tank_fmu(folder, version))))
    with pytest.raises(DriverError, match=r"the pump ran dry at 0\.2 s") as error, connection as m:
        periods(m, 2)
        driver = connection.driver("plant")
        assert isinstance(driver, Fmu)
        driver.write(driver.channel("fault"), 3)
        periods(m)
    assert not isinstance(error.value, StopError)
    assert list(unpacked.iterdir()) == []


# What users of other projects have reported -----------------------------------------------------------


@pytest.mark.parametrize("name", first(1, ["a höhe %20", "a b", "µ"]))
def test_a_path_with_blanks_or_letters_beyond_ascii_is_a_path(folder, version, tmp_path, monkeypatch, name):
    """CATIA-Systems/FMPy#230, viproma/coral#42: of the model, and of the folder in which it is unpacked."""
    for each in ("models", "unpacked"):
        (tmp_path / name / each).mkdir(parents=True)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / name / "unpacked"))
    model = tmp_path / name / "models" / f"{name}.fmu"
    shutil.copy(tank_fmu(folder, version), model)
    driver = Fmu(model=model)
    driver.period = 0.1
    driver.open()
    write(driver, inflow=1000, enable=1)
    tick(driver, 20)
    assert read(driver, "tank.level:0.001") == [round(1000 * (1 - math.exp(-1)))]
    driver.close()


def libraries() -> set[str]:
    """The libraries that this process has loaded."""
    lines = Path("/proc/self/maps").read_text().splitlines()
    return {line.split(maxsplit=5)[5] for line in lines if ".so" in line}


def test_a_model_for_one_instance_in_a_process_has_a_library_of_its_own_in_each_driver(folder, version, unpacked):
    """NTNU-IHB/FMI4cpp#42: two drivers load two copies of it, so their variables are not shared."""
    model = tank_fmu(folder, version, attributes='canBeInstantiatedOnlyOncePerProcess="true"')
    one, other = Fmu(model=model), Fmu(model=model)
    before = libraries()
    for driver in (one, other):
        driver.period = 0.1
        driver.open()
    assert len(libraries() - before) == 2
    write(one, count=7)
    assert read(other, "doubled") == [0]
    one.close()
    other.close()
