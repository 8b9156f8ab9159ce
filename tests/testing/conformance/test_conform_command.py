"""`umo device conform`: which driver, which channels, consent, certificates, exit status."""

from __future__ import annotations

import os
import pty
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pydantic import TypeAdapter
from typer.testing import Result

import umo as package
from conformance.device import Device
from helpers.tiers import first, named
from umo.errors import AcknowledgeRequired
from umo.process.station import StationError
from umo.system.device_lock import DeviceLock
from umo.system.device_record import DeviceClaim
from umo.testing.conformance import Certificate, PtyTap, all_rules, leak_rules, long_run, rules
from umo_command.device import conform as conform_command

Umo = Callable[..., Result]
OBJECTS = """
from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor
from umo.states import OnOff, PassFail


class Press(Compound):
    timer: DigitalSensor
    motor: DigitalActuator
    fan: BinaryActuator[OnOff]
    back: DigitalSensor
    encoder: DigitalSensor
    spare: DigitalSensor


def machine() -> Press:
    return Press(
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
        motor=DigitalActuator("V", default=1.0, minimum=0.0, maximum=5.1, resolution=0.02),
        fan=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
        back=DigitalSensor("mV", minimum=0.0, maximum=6000.0, resolution=20.0),
        encoder=DigitalSensor("mm", minimum=0.0, maximum=6000.0, resolution=1.0),
        spare=DigitalSensor("mm", minimum=0.0, maximum=6000.0, resolution=1.0),
    )
"""
WIRING = """
[drivers.card]
type = "conformance.careful:Careful"
port = PORT
timeout = "30 ms"

[wire]
"timer" = { driver = "timerfd", period = "1 ms" }
"motor" = { driver = "card", channel = "out:0", maximum = 4.0 }
"fan" = { driver = "card", channel = "out:1" }
"back" = { driver = "card", channel = "in:0" }
"encoder" = { driver = "card", channel = "in:9" }
"spare" = { driver = "simulated" }
"""


@pytest.fixture(autouse=True)
def few_transfers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where they are many in the search for what adds up."""
    monkeypatch.setattr(long_run, "LONG_RUN_TRANSFERS", 80)
    monkeypatch.setattr(leak_rules, "OPENINGS", 3)
    monkeypatch.setattr(leak_rules, "CYCLES", 10)


@pytest.fixture(params=first(1, named(["few", "all"], [True, False])))
def few_rules(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Of the kit `make test` tries these rules: a whole trial waits for 25 s, and test_kit.py has what they find."""

    def only(*names: str) -> None:
        few = tuple(rule for rule in all_rules() if rule.id in names)
        for module in (conform_command, rules) if request.param else ():
            monkeypatch.setattr(module, "all_rules", lambda: few)

    return only


@pytest.fixture
def device() -> Iterator[Device]:
    with Device() as device:
        yield device


@pytest.fixture
def press(tmp_path: Path, device: Device) -> Path:
    """A station whose card is the device."""
    folder = tmp_path / "press"
    (folder / "wiring").mkdir(parents=True)
    (folder / "objects.py").write_text(OBJECTS)
    (folder / "wiring" / "card.toml").write_text(WIRING.replace("PORT", str(device.port)))
    return folder


def said(result: Result) -> str:
    return " ".join((result.stdout + result.stderr).split())


def saved(file: str) -> Certificate:
    return TypeAdapter(Certificate).validate_json(Path(file).read_text())


def own_card(press: Path, text: str, *options: str) -> None:
    """The station's card is made by a module of its own, with these options in place of the port."""
    (press / "cards.py").write_text(
        "import os\nfrom pathlib import Path\n\nfrom conformance.careful import Careful\n" + text
    )
    file = press / "wiring" / "card.toml"
    lines = file.read_text().replace("conformance.careful:Careful", ".cards:Card").split("\n")
    file.write_text("\n".join(line for each in lines for line in (options if each.startswith("port") else [each])))


def test_a_wired_driver_is_tested_within_the_ranges_of_its_objects(
    umo: Umo, press: Path, device: Device, few_rules: Callable[..., None]
) -> None:
    few_rules(
        *("initialise", "range", "one beyond", "block write", "late answer", "garbled answer"),
        *("directions", "vanish", "end"),
    )
    device.levels("out:0")
    words = ("--yes", "--loopback", "motor=back", "--out", "made.json")
    result = umo("device", "conform", "press/wiring/card.toml", *words)
    assert result.exit_code == 0, said(result)
    assert f"press-card-card: passed, on device tcp 127.0.0.1:{device.port}" in said(result)
    assert "out:0 0 to 200" not in said(result)
    assert "motor out:0 0 to 200 0 to 4 V 1 V" in said(result).replace("│ ", "")
    certificate = saved("made.json")
    assert certificate.outputs == ("out:0 0 to 200", "out:1 0 to 1")
    assert max(device.levels("out:0")) <= 200
    passed = {each.rule for each in certificate.findings if each.verdict == "passed"}
    assert {"initialise", "range", "late answer", "vanish", "garbled answer", "directions", "end"} <= passed
    assert certificate.finding("one beyond").verdict == "not tried"
    assert certificate.finding("range").why == "except out:1, whose level cannot be seen"
    assert device.levels("out:0")[-1] == 50


def test_without_a_terminal_and_without_yes_nothing_is_driven(umo: Umo, press: Path, device: Device) -> None:
    result = umo("device", "conform", "press", "-w", "card")
    assert result.exit_code == 2
    assert said(result).endswith("umo: this command drives motor and fan over the whole range: confirm with --yes")
    assert "object channel raw levels" in said(result).replace("┃ ", "") and "0 to 4 V" in said(result)
    assert device.levels("out:0") == [0]


@pytest.mark.full
def test_only_the_listed_channels_are_used(umo: Umo, press: Path, device: Device) -> None:
    words = ("--only", "fan", "--only", "in:9", "--yes", "--out", "made.json")
    assert umo("device", "conform", "press", "-w", "card", *words).exit_code == 0
    certificate = saved("made.json")
    assert certificate.outputs == ("out:1 0 to 1",) and certificate.inputs == ("in:9",)
    assert device.levels("out:0") == [0]


def test_inputs_alone_are_read_without_a_question_and_nothing_is_written(
    umo: Umo, press: Path, device: Device, few_rules: Callable[..., None]
) -> None:
    few_rules("answers", "readings", "directions", "block read", "late answer", "finalise")
    result = umo("device", "conform", "press", "-w", "card", "--only", "encoder", "--only", "back")
    assert result.exit_code == 0, said(result)
    assert "directions" not in said(result)
    assert device.levels("out:0") == [0]


@pytest.mark.full
def test_an_input_that_is_steady_lets_the_line_be_tried_without_an_output(umo: Umo, press: Path) -> None:
    words = ("--only", "encoder", "--steady", "encoder", "--out", "made.json")
    result = umo("device", "conform", "press", "-w", "card", *words)
    assert result.exit_code == 0, said(result)
    certificate = saved("made.json")
    tried = {each.rule for each in certificate.findings if each.verdict == "passed"}
    assert {"late answer", "old answer", "short answer", "garbled answer", "retry", "vanish"} <= tried


PLACED = """
from umo.drivers.streams import Host


class Card(Careful):
    def __init__(self, *, host: str = "127.0.0.1", port: int | None = None) -> None:
        self.place = Host(host, port or PORT)
        super().__init__(host=host, port=self.place.port)
"""
MODEL = """

class Card(Careful):
    def __init__(self, *, model: Path, host: str = "127.0.0.1", port: int) -> None:
        super().__init__(host=host, port=port)
        model.read_text()
"""
LASTING = """
os.environ["UMO_LASTING"] = "imported"


class Card(Careful):
    def open(self) -> None:
        super().open()
        os.chdir("/")
"""
INPUT = ("device", "conform", "press", "-w", "card", "--only", "encoder", "--steady", "encoder")


@pytest.mark.full
def test_the_line_of_a_driver_that_knows_its_port_is_disturbed(umo: Umo, press: Path, device: Device) -> None:
    own_card(press, PLACED.replace("PORT", str(device.port)))
    result = umo(*INPUT)
    assert result.exit_code == 0, said(result)


@pytest.mark.full
def test_a_path_of_the_wiring_is_that_of_the_station(umo: Umo, press: Path, device: Device) -> None:
    own_card(press, MODEL, f"port = {device.port}", 'model = "data/model"')
    (press / "data").mkdir()
    (press / "data" / "model").write_text("a model")
    result = umo(*INPUT)
    assert result.exit_code == 0, said(result)


@pytest.mark.parametrize("word", first(1, ["chdir", "UMO_LASTING"]))
def test_what_a_driver_changes_of_the_process_before_the_first_rule_is_told(
    umo: Umo, press: Path, device: Device, monkeypatch: pytest.MonkeyPatch, few_rules: Callable[..., None], word: str
) -> None:
    few_rules("answers", "process")
    monkeypatch.setenv("UMO_LASTING", "not yet")
    folder = Path.cwd()
    monkeypatch.chdir(folder)  # and back at the end
    text = LASTING if word == "chdir" else LASTING.replace("os.chdir", "len")
    own_card(press, text, f"port = {device.port}")
    result = umo(*INPUT, "--out", "made.json")
    assert result.exit_code == 1, said(result)
    told = (
        "the driver changed the working directory from"
        if word == "chdir"
        else "the driver changed the environment: UMO_LASTING"
    )
    assert saved(str(folder / "made.json")).finding("process").why.startswith(told)


@pytest.mark.parametrize(("file", "why"), [("none/x", "there is no folder none"), (".", "is a folder")])
def test_a_file_that_cannot_be_written_is_told_before_anything_is_driven(
    umo: Umo, press: Path, device: Device, file: str, why: str
) -> None:
    result = umo("device", "conform", "press", "-w", "card", "--yes", "--out", file)
    assert (result.exit_code, said(result)) == (2, f"umo: --out {file}: {why}")
    assert device.levels("out:0") == [0]


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ("", {"parity": "even", "data_bits": 8}),
        ('parity = "odd"', {"parity": "odd", "data_bits": 8}),
        ("rs485 = true", None),
    ],
)
def test_the_tap_on_a_serial_line_has_the_settings_of_the_driver(
    umo: Umo, press: Path, monkeypatch: pytest.MonkeyPatch, options: str, expected: dict[str, object] | None
) -> None:
    made = []

    class Refused(PtyTap):
        def __init__(self, path: str, **settings: object) -> None:
            made.append((path, settings))
            raise StationError("a tap was made")

    monkeypatch.setattr(conform_command, "PtyTap", Refused)
    device = f"/dev/umo-none-{os.getpid()}"
    line = f'[drivers.card]\ntype = "modbus"\nserial = "{device}"\n{options}\n'
    wires = [f'"{name}" = {{ driver = "simulated" }}' for name in ("motor", "fan", "back", "spare")]
    wires.append('"timer" = { driver = "timerfd", period = "1 ms" }')
    text = "\n".join([line, "[wire]", '"encoder" = { driver = "card", channel = "input:0" }', *wires])
    (press / "wiring" / "line.toml").write_text(text)
    result = umo("device", "conform", "press", "-w", "line", "--driver", "card")
    assert ("a tap was made" if expected else f"no device {device}") in said(result), said(result)
    assert made == ([(device, expected)] if expected else []), said(result)


@pytest.mark.full
def test_a_run_that_was_cut_short_is_status_3_and_says_what_it_will_take(umo: Umo, press: Path) -> None:
    result = umo("device", "conform", "press", "-w", "card", "--yes", "--for", "3 s")
    assert result.exit_code == 3, said(result)
    assert "umo: a transfer takes " in said(result) and "first leaves out transfers of the long run" in said(result)
    assert "press-card-card: passed (cut short), on device tcp" in said(result)


def test_a_simulation_has_no_line_which_is_status_3(umo: Umo, few_rules: Callable[..., None]) -> None:
    few_rules("answers", "range", "late answer", "end")
    result = umo("device", "conform", "conveyor")
    assert result.exit_code == 3, said(result)
    assert "passed (the line was not tried)" in said(result)


def test_a_broken_rule_is_status_1_and_in_words(umo: Umo, press: Path, few_rules: Callable[..., None]) -> None:
    few_rules("answers", "readings", "range", "directions")
    file = press / "wiring" / "card.toml"
    file.write_text(file.read_text().replace("careful:Careful", "broken:ReadsAFloat"))
    result = umo("device", "conform", "press", "-w", "card", "--yes")
    assert result.exit_code == 1
    assert "readings │ failed │ A reading is an int, within the bits of its channel." in said(result)
    assert "[read of in:0 returned" in said(result)
    assert "2 rules passed, 1 rule failed, 1 rule not tried" in said(result)


MISTAKES = {
    "--driver cord": "there is no driver 'cord' (did you mean 'card'?) in the wiring: card, timerfd, simulated",
    "--only out:7": "'out:7' is a channel of card, but no object is wired to it (did you mean 'out:1'?)",
    "--only out": "'out' is neither a channel of card nor an object wired to it (did you mean 'out:1'?)",
    "--only motor --loopback out:0=in:3": "'in:3' is a channel of card, but no object is wired to it; both ends of a "
    "loop-back need an object, which --only must not leave out",
    "--only motor --loopback motor=back": "'back' is wired to card, but cannot be chosen here; both ends of a "
    "loop-back need an object, which --only must not leave out",
    "--steady motor": "'motor' is wired to card, but cannot be chosen here; --steady needs an input",
    "--loopback motor": "--loopback motor: give OUTPUT=INPUT",
    "--loopback back=motor": "--loopback back=motor: back must be an actuator and motor a channel that can be read",
    "--refused out:0": "--refused out:0: motor is wired to this channel",
    "--only nothing": "'nothing' is neither a channel of card nor an object wired to it",
}


@pytest.mark.parametrize("words", MISTAKES)
def test_a_mistake_is_one_line_with_what_there_is(umo: Umo, press: Path, words: str) -> None:
    result = umo("device", "conform", "press", "-w", "card", "--yes", *words.split())
    assert result.exit_code == 2
    assert said(result) == f"umo: {MISTAKES[words]}"


def test_the_timer_of_a_wiring_may_be_a_plant_in_virtual_time(
    umo: Umo, press: Path, few_rules: Callable[..., None]
) -> None:
    few_rules("answers", "late answer", "end")
    file = press / "wiring" / "card.toml"
    file.write_text(file.read_text().replace("timerfd", "simulated"))
    result = umo("device", "conform", "press", "-w", "card", "--driver", "card", "--yes")
    assert result.exit_code == 0, said(result)


def test_a_wiring_file_without_a_station_is_a_mistake(umo: Umo, tmp_path: Path) -> None:
    assert said(umo("device", "conform", "nothing.toml")) == "umo: there is no wiring nothing.toml"
    (tmp_path / "deep" / "deeper").mkdir(parents=True)
    (tmp_path / "deep" / "deeper" / "lone.toml").write_text("[wire]\n")
    result = umo("device", "conform", "deep/deeper/lone.toml")
    assert result.exit_code == 2
    assert said(result) == (
        "umo: deep/deeper/lone.toml is not in the folder of a station; give the station, and the wiring with -w"
    )


def test_a_device_that_is_not_there_is_one_line_and_status_1(umo: Umo, press: Path) -> None:
    file = press / "wiring" / "card.toml"
    file.write_text(file.read_text().replace("port = ", "port = 1 # "))
    result = umo("device", "conform", "press", "-w", "card", "--yes")
    assert result.exit_code == 1
    assert len(result.stderr.strip().splitlines()) < 12
    assert "umo: driver card (device tcp 127.0.0.1:1): " in said(result)


@pytest.mark.full
def test_a_channel_that_the_device_refuses_lets_error_answers_be_tried(umo: Umo, press: Path) -> None:
    words = ("--yes", "--refused", "in:40", "--refused", "io:40", "--out", "made.json")
    assert umo("device", "conform", "press", "-w", "card", "--loopback", "motor=back", *words).exit_code == 0
    certificate = saved("made.json")
    assert certificate.finding("error answer").verdict == "passed"
    assert certificate.finding("block failures").verdict == "passed"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="devices are held on Linux")
def test_an_earlier_unsafe_end_stays_if_the_device_cannot_be_opened(umo: Umo, press: Path) -> None:
    name = "device tcp 127.0.0.1:1"
    DeviceClaim([name], "press").stopped("a test", ["motor"])
    file = press / "wiring" / "card.toml"
    file.write_text(file.read_text().replace("port = ", "port = 1 # "))
    result = umo("device", "conform", "press", "-w", "card", "--yes", "--acknowledge")
    assert result.exit_code == 1, said(result)
    with pytest.raises(AcknowledgeRequired):
        DeviceClaim([name], "press")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="devices are held on Linux")
def test_a_device_that_another_program_holds_is_left_alone(umo: Umo, press: Path, device: Device) -> None:
    kept = DeviceLock([f"device tcp 127.0.0.1:{device.port}"], "oven")
    try:
        result = umo("device", "conform", "press", "-w", "card")
    finally:
        kept.release()
    assert result.exit_code == 2
    assert "confirm with --yes" not in said(result) and "outputs to drive" not in said(result)  # held before it asks
    assert "is held by" in said(result) and "(oven), since" in said(result)
    assert device.levels("out:0") == [0]


def command(*words: str) -> tuple[list[str], dict[str, str]]:
    """The command in a process of its own, with the modules of the tests."""
    places = [str(Path(package.__file__).parents[1]), *map(str, Path(__file__).parents[1:3])]
    return [sys.executable, "-c", "from umo_command import main; main()", *words], os.environ | {
        "PYTHONPATH": os.pathsep.join(places)
    }


@pytest.mark.parametrize("answer", ["n", "", "yet", EOFError()])
def test_without_consent_nothing_is_driven_of_the_outputs_that_it_lists(
    umo: Umo, press: Path, device: Device, monkeypatch: pytest.MonkeyPatch, answer: Any
) -> None:
    asked = []

    def answered(question: str) -> str:
        asked.append(question)
        if isinstance(answer, Exception):
            raise answer
        return str(answer)

    monkeypatch.setattr(conform_command, "sys", SimpleNamespace(stdin=SimpleNamespace(isatty=lambda: True)))
    monkeypatch.setattr(conform_command, "input", answered, raising=False)
    result = umo("device", "conform", "press", "-w", "card")
    assert (result.exit_code, len(asked)) == (2, 1)
    assert asked[0].endswith("[y/N] ")
    assert all(text in said(result) for text in ("motor", "0 to 200", "0 to 4 V", "umo: nothing was driven"))
    assert device.levels("out:0") == [0]


@pytest.mark.full
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a terminal of Linux")
@pytest.mark.parametrize("answer", ["n", ""])
def test_at_a_terminal_it_lists_the_outputs_and_asks(press: Path, device: Device, answer: str) -> None:
    words, environment = command("device", "conform", str(press), "-w", "card")
    terminal, inner = pty.openpty()
    process = subprocess.Popen(words, stdin=inner, stdout=inner, stderr=inner, env=environment)
    os.close(inner)
    seen = _until(terminal, "[y/N]")
    assert "motor" in seen and "0 to 200" in seen and "0 to 4 V" in seen
    os.write(terminal, f"{answer}\n".encode())
    assert "umo: nothing was driven" in _until(terminal, "nothing was driven")
    assert process.wait(20) == 2
    os.close(terminal)
    assert device.levels("out:0") == [0]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a terminal of Linux")
@pytest.mark.parametrize("number", first(1, [signal.SIGINT, signal.SIGTERM]))
def test_a_signal_ends_it_with_the_outputs_at_their_defaults(press: Path, device: Device, number: int) -> None:
    words, environment = command("device", "conform", str(press), "-w", "card")
    terminal, inner = pty.openpty()
    process = subprocess.Popen(words, stdin=inner, stdout=inner, stderr=inner, env=environment)
    os.close(inner)
    _until(terminal, "[y/N]")

    def interrupt() -> None:
        device.when_driven = lambda: None
        process.send_signal(number)

    device.when_driven = interrupt
    os.write(terminal, b"y\n")
    _until(terminal, "umo: stopped; every output is at its default")
    while select.select([terminal], [], [], 20)[0]:  # a terminal that nobody reads holds the process up
        try:
            os.read(terminal, 4096)
        except OSError:
            break
    assert process.wait(20) == 130
    os.close(terminal)
    assert device.levels("out:0")[-1] == 50


def _until(terminal: int, word: str, patience: float = 30.0) -> str:
    seen, end = "", time.monotonic() + patience
    while word not in seen:
        assert select.select([terminal], [], [], max(0.0, end - time.monotonic()))[0], seen[-500:]
        try:
            seen += os.read(terminal, 4096).decode(errors="replace")
        except OSError:  # the process has ended
            pytest.fail(f"ended without {word!r}: {seen[-800:]}")
    return seen


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="devices are held on Linux")
def test_an_earlier_unsafe_end_stays_without_consent(umo: Umo, press: Path, device: Device) -> None:
    name = f"device tcp 127.0.0.1:{device.port}"
    DeviceClaim([name], "press").stopped("a test", ["motor"])
    assert "confirm with --yes" in said(umo("device", "conform", "press", "-w", "card", "--acknowledge"))
    with pytest.raises(AcknowledgeRequired):
        DeviceClaim([name], "press")
