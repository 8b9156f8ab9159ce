"""The gpio driver on the kernel's simulated chips: levels, groups, edges, and what goes wrong."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from time import monotonic

import gpiod
import numpy as np
import pytest
from gpiod.line import Direction, Value

from umo.drivers.gpio import Gpio
from umo.errors import DriverError

from .gpio_sim import Chip, Trace

Make = Callable[..., Gpio]

HOLDER = """
import gpiod, sys, time
request = gpiod.request_lines(sys.argv[1], consumer=sys.argv[2], config={7: None})
print("held", flush=True)
sys.stdin.readline()
"""


@pytest.fixture
def chip(gpio_chip: Callable[..., Chip]) -> Chip:
    return gpio_chip(lines=16, names={3: "PUMP", 8: "A", 9: "B", 12: "TWICE", 13: "TWICE"}, hogs={15: "kernel"})


@pytest.fixture
def gpio(chip: Chip) -> Iterator[Make]:
    """Makes open drivers, with these channels in their wiring."""
    made: list[Gpio] = []

    def make(*texts: str, **options: object) -> Gpio:
        made.append(Gpio(chip=chip.path, **options))  # type: ignore[arg-type]
        for text in texts:
            made[-1].channel(text)
        made[-1].open()
        return made[-1]

    yield make
    for driver in made:
        driver.close()


def use(driver: Gpio, text: str, default: int | None = None) -> None:
    driver.initialize(driver.channel(text), default)


def read(driver: Gpio, text: str) -> int:
    return driver.read(driver.channel(text))


def write(driver: Gpio, text: str, raw: int) -> None:
    driver.write(driver.channel(text), raw)


# Levels -----------------------------------------------------------------------------------------------


def test_an_output_follows_its_writes_and_an_input_reads_its_level(chip: Chip, gpio: Make) -> None:
    driver = gpio("line:0", "line:PUMP")
    use(driver, "line:0", 0)
    use(driver, "line:PUMP")
    for level in (1, 0, 1):
        write(driver, "line:0", level)
        assert chip.line(0).value == level == read(driver, "line:0")
        chip.line(3).pull(level)
        assert read(driver, "line:PUMP") == level


@pytest.mark.parametrize("named", [True, False], ids=["in the wiring", "after opening"])
@pytest.mark.parametrize("default", [0, 1])
def test_an_output_comes_up_at_its_default_with_no_other_level_in_between(
    chip: Chip, gpio: Make, named: bool, default: int
) -> None:
    chip.line(0).pull(1 - default)
    with Trace(chip.label) as trace:
        driver = gpio(*["line:0", "line:1"] if named else [])
        use(driver, "line:1", 0)
        use(driver, "line:0", default)
    events = [what for line, what in trace.events() if line == 0]
    assert events == [f"set {default}", "out"]
    assert chip.line(0).value == default


def test_opening_and_initialising_change_no_other_line(chip: Chip, gpio: Make) -> None:
    with gpiod.request_lines(chip.path, {2: gpiod.LineSettings(direction=Direction.OUTPUT, output_value=Value.ACTIVE)}):
        with Trace(chip.label) as trace:
            driver = gpio("line:0", "line:1", "line:4")
            assert trace.events() == []
            use(driver, "line:0", 1)
        assert {line for line, _ in trace.events()} == {0}
        assert chip.line(2).value == 1


def test_initialising_a_line_leaves_the_levels_of_the_others(chip: Chip, gpio: Make) -> None:
    driver = gpio("line:0", "line:1", "line:2")
    use(driver, "line:0", 0)
    write(driver, "line:0", 1)
    with Trace(chip.label) as trace:
        use(driver, "line:1", 1)
        use(driver, "line:2")
    assert {what for line, what in trace.events() if line == 0} <= {"set 1", "out"}
    assert chip.levels()[:3] == [1, 1, 0]


def test_a_group_is_one_number_lowest_bit_first(chip: Chip, gpio: Make) -> None:
    driver = gpio("lines:4-7", "lines:B,A,PUMP", "lines:11-10")
    use(driver, "lines:4-7", 0b0110)
    use(driver, "lines:B,A,PUMP")
    use(driver, "lines:11-10", 1)
    assert chip.levels()[4:8] == [0, 1, 1, 0]
    assert chip.levels()[10:12] == [0, 1]
    write(driver, "lines:4-7", 0b1001)
    assert chip.levels()[4:8] == [1, 0, 0, 1]
    chip.line(9).pull(1)
    chip.line(3).pull(1)
    assert read(driver, "lines:B,A,PUMP") == 0b101


def test_a_block_is_one_transfer_of_all_its_channels(chip: Chip, gpio: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    texts = ["line:0", "lines:4-6", "line:PUMP", "line:1"]
    driver = gpio(*texts, "edges:2")
    for text, default in zip(texts, [0, 0, 0, 0], strict=True):
        use(driver, text, default)
    use(driver, "edges:2")
    channels = tuple(map(driver.channel, texts))
    calls = []
    whole = gpiod.LineRequest.set_values
    monkeypatch.setattr(
        gpiod.LineRequest, "set_values", lambda self, values: (calls.append(len(values)), whole(self, values))
    )
    driver.write_many(channels, np.array([1, 5, 0, 1]))
    assert calls == [6]
    assert chip.levels()[:8] == [1, 1, 0, 0, 1, 0, 1, 0]
    out = np.empty(5, np.int64)
    chip.line(2).pulse()
    driver.read_many((*channels[:2], driver.channel("edges:2"), *channels[2:]), out)
    assert out.tolist() == [1, 5, 1, 0, 1]


def test_a_block_is_the_same_as_single_transfers_whatever_its_order(gpio: Make, chip: Chip) -> None:
    driver = gpio("line:6", "line:1")
    for text in ("line:6", "line:1", "line:4", "line:0"):  # the last two in requests of their own
        use(driver, text, 0)
    channels = tuple(driver.channel(text) for text in ("line:0", "line:6", "line:4", "line:1"))
    for raws in ([1, 0, 0, 1], [0, 1, 1, 0], [1, 1, 0, 0]):
        driver.write_many(channels, np.array(raws))
        out = np.empty(4, np.int64)
        driver.read_many(channels, out)
        assert out.tolist() == raws == [driver.read(channel) for channel in channels]
        assert [chip.line(number).value for number in (0, 6, 4, 1)] == raws


def test_more_than_64_lines_are_moved_together(gpio_chip: Callable[..., Chip]) -> None:
    chip = gpio_chip(lines=150)
    driver = Gpio(chip=chip.path)
    channels = tuple(driver.channel(f"line:{number}") for number in range(150))
    driver.open()
    for channel in channels:
        driver.initialize(channel, 0)
    raws = np.arange(150) % 3 == 0
    driver.write_many(channels, raws.astype(np.int64))
    assert chip.levels() == raws.astype(int).tolist()
    driver.close()


def test_a_value_that_does_not_fit_changes_no_line(chip: Chip, gpio: Make) -> None:
    driver = gpio("line:0", "line:1", "lines:4-5")
    for text in ("line:0", "line:1", "lines:4-5"):
        use(driver, text, 0)
    single = (driver.channel("line:0"), driver.channel("line:1"))
    for channels, raws in ((single, [1, 2]), (single, [1, -1]), ((*single, driver.channel("lines:4-5")), [1, 1, 4])):
        with pytest.raises(DriverError, match="does not fit line"):
            driver.write_many(channels, np.array(raws))
    assert chip.levels() == [0] * 16


# Settings ---------------------------------------------------------------------------------------------


def test_active_low_inverts_an_output_and_an_input(chip: Chip, gpio: Make) -> None:
    driver = gpio(active_low=True)
    use(driver, "line:0", 0)
    use(driver, "line:1")
    use(driver, "line:2 active_high", 1)
    assert chip.levels()[:3] == [1, 0, 1]
    assert read(driver, "line:1") == 1


@pytest.mark.parametrize(("bias", "level"), [("pull-up", 1), ("pull-down", 0)])
def test_the_bias_pulls_an_input(chip: Chip, gpio: Make, bias: str, level: int) -> None:
    chip.line(1).pull(1 - level)
    driver = gpio(f"line:1 bias={bias}")
    use(driver, f"line:1 bias={bias}")
    assert read(driver, f"line:1 bias={bias}") == level == chip.line(1).pulled


def test_settings_reach_the_kernel(chip: Chip, gpio: Make) -> None:
    driver = gpio(bias="pull-up", drive="open-drain", debounce="5 ms")
    use(driver, "line:1")
    use(driver, "line:2 drive=open-source", 0)
    use(driver, "edges:4 debounce=2ms")
    with gpiod.Chip(chip.path) as other:
        lines = [other.get_line_info(number) for number in (1, 2, 4)]
    assert [line.bias.name for line in lines] == ["PULL_UP", "PULL_UP", "PULL_UP"]
    assert [line.drive.name for line in lines] == ["PUSH_PULL", "OPEN_SOURCE", "PUSH_PULL"]
    assert [line.debounce_period.microseconds for line in lines] == [5000, 0, 2000]
    assert [line.consumer for line in lines] == ["umo"] * 3


# Edges ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("edges", "count"), [("", 3), (":rising", 3), (":falling", 3), (":both", 6)])
def test_edges_are_counted_from_initialisation(chip: Chip, gpio: Make, edges: str, count: int) -> None:
    driver = gpio(f"edges:4{edges}")
    chip.line(4).pulse()
    use(driver, f"edges:4{edges}")
    assert read(driver, f"edges:4{edges}") == 0
    chip.line(4).pulse(3)
    assert read(driver, f"edges:4{edges}") == count
    assert read(driver, f"edges:4{edges}") == count


def test_a_count_is_right_after_the_kernels_buffer_has_overflowed(chip: Chip, gpio: Make) -> None:
    """The buffer holds 16 events."""
    driver = gpio("edges:4:both")
    use(driver, "edges:4:both")
    chip.line(4).pulse(25)
    assert read(driver, "edges:4:both") == 50
    chip.line(4).pulse()
    assert read(driver, "edges:4:both") == 52


def test_reset_does_not_change_a_count(chip: Chip, gpio: Make) -> None:
    driver = gpio("edges:4")
    use(driver, "edges:4")
    chip.line(4).pulse(2)
    driver.reset(driver.channel("edges:4"), None)
    assert read(driver, "edges:4") == 2


def test_a_count_goes_on_while_other_lines_are_initialised_and_written(chip: Chip, gpio: Make) -> None:
    driver = gpio("edges:4", "line:0")
    use(driver, "edges:4")
    chip.line(4).pulse(2)
    use(driver, "line:0", 1)
    write(driver, "line:0", 0)
    use(driver, "line:5")
    chip.line(4).pulse()
    assert read(driver, "edges:4") == 3


# Life -------------------------------------------------------------------------------------------------


def test_reset_brings_an_output_to_its_default_also_where_it_was_not_initialised(chip: Chip, gpio: Make) -> None:
    driver = gpio("line:0", "line:1")
    use(driver, "line:0", 0)
    write(driver, "line:0", 1)
    driver.reset(driver.channel("line:0"), 0)
    with Trace(chip.label) as trace:
        driver.reset(driver.channel("line:1"), 1)
    assert chip.levels()[:2] == [0, 1]
    assert [what for line, what in trace.events() if line == 1] == ["set 1", "out"]


def test_channels_are_finalised_and_initialised_again_in_any_order_and_direction(chip: Chip, gpio: Make) -> None:
    driver = gpio("line:0", "line:1", "edges:4")
    for _ in range(3):
        for text, default in (("line:1", 0), ("edges:4", None), ("line:0", 1)):
            use(driver, text, default)
        write(driver, "line:1", 1)
        chip.line(4).pulse()
        assert (chip.levels()[:2], read(driver, "edges:4")) == ([1, 1], 1)
        for text in ("line:0", "edges:4", "line:1"):
            driver.finalize(driver.channel(text))
        use(driver, "line:0")  # now an input
        chip.line(0).pull(0)
        assert read(driver, "line:0") == 0
        driver.finalize(driver.channel("line:0"))


def test_closing_releases_every_line_and_the_driver_can_be_opened_again(chip: Chip, gpio: Make) -> None:
    driver = gpio("line:0", "edges:4")
    for _ in range(3):
        use(driver, "line:0", 1)
        use(driver, "edges:4")
        driver.close()
        driver.close()
        with gpiod.Chip(chip.path) as other:
            assert not [number for number in range(15) if other.get_line_info(number).used]
        with pytest.raises(DriverError, match="not open"):
            read(driver, "line:0")
        driver.open()
    use(driver, "line:0", 1)
    assert chip.line(0).value == 1


def test_ten_thousand_cycles_leak_no_descriptors_and_no_memory(gpio: Make) -> None:
    driver = gpio("line:0", "edges:4")
    use(driver, "line:0", 0)
    use(driver, "edges:4")
    sizes = []
    for _ in range(3):
        for i in range(5_000):
            write(driver, "line:0", i & 1)
            read(driver, "edges:4")
        sizes.append(int(Path("/proc/self/statm").read_text().split()[1]))  # resident, in pages of 4 kB
    assert sizes[2] - sizes[0] < 50
    before = len(os.listdir("/proc/self/fd"))
    driver.close()
    driver.open()
    assert len(os.listdir("/proc/self/fd")) < before


def test_a_chip_that_goes_fails_and_one_that_comes_back_is_used_again(chip: Chip) -> None:
    driver = Gpio(chip=chip.label)
    for text in ("line:0", "line:1", "edges:4"):
        driver.channel(text)
    driver.open()
    use(driver, "line:0", 1)
    use(driver, "line:1")
    use(driver, "edges:4")
    chip.line(4).pulse(2)
    assert read(driver, "edges:4") == 2
    chip.go()
    with pytest.raises(DriverError, match="the chip has gone"):
        read(driver, "line:1")
    with pytest.raises(DriverError, match="no GPIO chip 'sim0'"):
        write(driver, "line:0", 0)
    chip.come()
    chip.line(1).pull(1)
    assert read(driver, "line:1") == 1
    assert chip.line(0).value == 1
    write(driver, "line:0", 0)
    assert chip.line(0).value == 0
    chip.line(4).pulse()
    assert read(driver, "edges:4") == 3
    driver.close()


def test_after_a_process_was_killed_another_resets_its_outputs(chip: Chip) -> None:
    code = f"""
from umo.drivers.gpio import Gpio
driver = Gpio(chip={chip.path!r})
driver.open()
driver.initialize(driver.channel("line:0"), 1)
driver.write(driver.channel("line:0"), 0)
print("up", flush=True)
input()
"""
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        driver = Gpio(chip=chip.path)
        driver.timeout = 0.2
        channel = driver.channel("line:0")
        driver.open()  # while the other one has the line
        with pytest.raises(DriverError, match='line 0 is in use by "umo"'):
            driver.reset(channel, 1)
        process.send_signal(signal.SIGKILL)
        driver.timeout = 5.0
        driver.reset(channel, 1)  # which waits until the kernel has let the line go
        assert chip.line(0).value == 1
        driver.close()


# Errors -----------------------------------------------------------------------------------------------


def test_a_busy_line_names_its_consumer_at_once_and_the_others_are_usable(chip: Chip, gpio: Make) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, chip.path, "sysfs"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        driver = gpio("line:7", "line:0")
        driver.timeout = 10.0
        began = monotonic()
        with pytest.raises(DriverError, match=rf'^{chip.path}: line 7 is in use by "sysfs"$'):
            use(driver, "line:7", 0)
        assert monotonic() - began < 5.0
        use(driver, "line:0", 1)
        process.communicate(b"\n")
    use(driver, "line:7", 0)
    with pytest.raises(DriverError, match='line 15 is in use by "kernel"'):
        use(driver, "line:15")


def test_lines_that_do_not_exist_are_named(chip: Chip, gpio: Make) -> None:
    driver = gpio("line:40", "line:PUMPE", "line:TWICE")
    for text, message in (
        ("line:40", "has no line 40: it has lines 0 to 15"),
        ("line:PUMPE", r"no line named 'PUMPE' \(did you mean 'PUMP'\?\)"),
        ("line:TWICE", "lines 12 and 13 are both named 'TWICE'"),
        ("lines:3,PUMP", "names a line twice"),
    ):
        with pytest.raises(DriverError, match=message):
            use(driver, text)


@pytest.mark.parametrize(
    ("number", "message"),
    [
        (errno.ENODEV, "line 4 has no interrupt: its edges cannot be counted"),
        (errno.EOPNOTSUPP, "line 4: the chip does not take these settings"),
        (errno.E2BIG, "line 4: the kernel takes at most 10 different settings"),
    ],
)
def test_a_line_that_the_chip_refuses_says_why(
    gpio: Make, monkeypatch: pytest.MonkeyPatch, number: int, message: str
) -> None:
    """gpio-sim takes everything: its answer is replaced."""
    driver = gpio("edges:4")

    def refuse(*arguments: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(gpiod.Chip, "request_lines", refuse)
    with pytest.raises(DriverError, match=message):
        use(driver, "edges:4")


def test_a_chip_that_has_gone_is_not_taken_for_one_without_interrupts(chip: Chip, gpio: Make) -> None:
    driver = gpio("edges:4")
    chip.go()
    with pytest.raises(DriverError, match="the chip has gone"):
        use(driver, "edges:4")


def test_one_line_under_two_names_is_refused(gpio: Make) -> None:
    driver = gpio("line:3", "line:PUMP")
    use(driver, "line:3")
    with pytest.raises(DriverError, match=r"line:PUMP and line:3 are both line 3 \(PUMP\)"):
        use(driver, "line:PUMP", 0)


def test_an_input_cannot_be_written_and_a_channel_needs_to_be_initialised(chip: Chip, gpio: Make) -> None:
    driver = gpio("line:0", "line:1")
    use(driver, "line:0")
    with pytest.raises(DriverError, match="line:0 is an input"):
        write(driver, "line:0", 1)
    with pytest.raises(DriverError, match="line:1 is not initialised"):
        read(driver, "line:1")
    with pytest.raises(DriverError, match="line:1 cannot have the default 2"):
        use(driver, "line:1", 2)


def test_chips_are_found_by_path_name_and_label_as_one_device(chip: Chip, tmp_path: Path) -> None:
    link = tmp_path / "relays"
    link.symlink_to(chip.path)
    spellings = [chip.path, Path(chip.path).name, chip.label, str(link)]
    assert {tuple(Gpio(chip=each).devices()) for each in spellings} == {(f"gpio {chip.path}",)}
    for each in spellings:
        driver = Gpio(chip=each)
        driver.open()
        driver.close()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("sin0", r"no GPIO chip 'sin0' \(did you mean 'sim0'\?\); there are: /dev/gpiochip0 \(fixed\), .* \(sim0\)"),
        ("/dev/gpiochip77", "no device /dev/gpiochip77; there are: /dev/gpiochip0"),
        ("/dev/null", "/dev/null is not a GPIO chip"),
    ],
)
def test_a_chip_that_does_not_exist_is_an_error_with_those_that_do(chip: Chip, name: str, message: str) -> None:
    driver = Gpio(chip=name)
    with pytest.raises(DriverError, match=message):
        driver.open()
    driver.close()
    assert list(driver.devices()) == [f"gpio {name}"]


def test_two_chips_of_one_label_are_told_apart_by_path(gpio_chip: Callable[..., Chip]) -> None:
    one, other = gpio_chip(label="relays"), gpio_chip(label="relays")
    with pytest.raises(
        DriverError, match=rf"{one.path} \(relays\) and {other.path} \(relays\) both have the name 'relays'"
    ):
        Gpio(chip="relays").open()


def test_without_permission_the_file_is_named(chip: Chip) -> None:
    os.chmod(chip.path, 0o600)
    code = """
import getpass, grp, os, sys
from umo.drivers.gpio import Gpio
path, label = Gpio(chip=sys.argv[1]), Gpio(chip="sim0")
os.setgid(65534); os.setuid(65534)
for driver in (path, label):
    try:
        driver.open()
    except OSError as error:
        print(error)
"""
    run = [sys.executable, "-c", code, chip.path]
    path, label = subprocess.run(run, stdout=subprocess.PIPE, text=True, check=True).stdout.splitlines()
    assert path.startswith(f"no permission to open {chip.path}; its permissions are 600")
    assert label.startswith("there is no GPIO chip 'sim0'; there are: ")
    assert f"no permission to open {chip.path}" in label
