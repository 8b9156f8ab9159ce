"""Lines of a wiring that give a part to a controller: what is wrong is told with its key, and `umo new controller`
makes the controller of that part."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from helpers.split_parts import THETA
from umo.cycle.laid_out import wired_numbers
from umo.drivers.wrapping import bare
from umo.errors import DeclarationError
from umo.generate.controller_folder import write_folder
from umo.generate.controller_generator import target_of
from umo.generate.split.part_generator import part_files
from umo.wiring import check, resolve


def mistakes(change: Any) -> str:
    wiring = THETA.wiring(1)
    change(wiring)
    return "\n".join(map(str, check(THETA.machine(), wiring)))


def test_a_part_on_a_controller_needs_no_line_for_its_objects() -> None:
    assert mistakes(lambda wiring: None) == ""


@pytest.mark.parametrize(
    ("lines", "text"),
    [
        ({"thata": {"controller": "drive"}}, "wire.\"thata\": the machine has no such part (did you mean 'theta'?)"),
        (
            {"theta.step": {"controller": "drive"}},
            'wire."theta.step": is an object; only a part can run on a controller',
        ),
        ({"z": {"controller": "drive"}}, "drive already runs another part: one part for each controller"),
        ({"theta": {"controller": "drive", "period": 1}}, 'must be { controller = "NAME" } and nothing else'),
        ({"theta.step": {"driver": "simulated"}}, "theta.step must be wired to drive, like the part"),
        ({"z.motor": {"driver": "drive"}}, "z.motor does not belong to this part, and cannot be wired to drive"),
        ({"theta": {"controller": "simulated"}}, "simulated is not a controller"),
    ],
)
def test_a_mistake_is_told_with_its_key(lines: dict[str, Any], text: str) -> None:
    assert text in mistakes(lambda wiring: wiring["wire"].update(lines))


def test_the_folder_is_that_of_the_part_alone(tmp_path: Path) -> None:
    files = part_files(THETA.machine(), THETA.wiring(1), "drive", target_of("cortex-m"))
    assert "OUT_theta_step = 0" in files["machine.h"]
    assert "z_motor" not in files["machine.h"]
    assert "#define LINK_HOST_TIMEOUT 150u" in files["machine_link.h"]
    assert {"main_link.c", "umo_link.c", "io_link.c", "io_board.c"} <= files.keys()
    assert "main.c" not in files
    write_folder(files, tmp_path)
    assert "runs `theta` of a machine" in (tmp_path / "README.md").read_text()


def test_a_controller_that_the_wiring_does_not_have_is_told() -> None:
    with pytest.raises(DeclarationError, match=r"no part runs on a controller 'driv' \(did you mean 'drive'\?\)"):
        part_files(THETA.machine(), THETA.wiring(1), "driv", target_of("host"))
    with pytest.raises(DeclarationError, match='write real = "float"'):
        part_files(THETA.machine(), THETA.wiring(1), "drive", target_of("avr"))


def test_both_ends_agree_on_the_hash_and_a_gain_does_not_change_it() -> None:
    def of_controller(wiring: Any) -> str:
        header = part_files(THETA.machine(), wiring, "drive", target_of("cortex-m"))["machine_link.h"]
        return header.partition("#define LINK_HASH ")[2].partition("u\n")[0]

    def of_host(wiring: Any) -> str:
        machine = THETA.machine()
        wired = resolve(machine, wiring)
        with wired_numbers(machine, wired):
            return str(bare(wired.drivers["drive"]).take_part(machine.theta, wired).hash)  # type: ignore[attr-defined]

    tuned = THETA.wiring(1) | {"parameters": {"theta.following_error": 2.5}}
    found = of_controller(THETA.wiring(1))
    assert found == of_host(THETA.wiring(1)) == of_controller(tuned) == of_host(tuned)
    assert found != of_controller(THETA.wiring(1, host_timeout="50 ms"))
