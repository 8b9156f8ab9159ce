"""The simulated z-theta station behind the driver contract."""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Sequence
from ctypes import c_int64
from random import Random

import numpy as np
import pytest

from helpers.in_c import TRANSFER
from umo.drivers import Direction
from umo.drivers.transfers_in_c import native
from umo.errors import ChannelError, DriverError, WiringError

pytest.importorskip("mujoco")

from umo.stations.ztheta import courier
from umo.stations.ztheta.devices import Counterbalance, EncoderCounter, SuctionCup
from umo.stations.ztheta.plant import Plant

BALANCED, SUNK = 3, 0
"""Seeds that start with the nominal pressure low in the travel, and without any."""
PICK_UM, TRANSIT_UM = 59_800.0, 110_000.0


def opened(*, period: float = 0.001, **options: object) -> Plant:
    machine = Plant(**options)  # type: ignore[arg-type]
    machine.period = period
    machine.open()
    return machine


def write(machine: Plant, **levels: int) -> None:
    """write(machine, dac=5, step=1): by the last part of the channel's name, the z drives by the first."""
    for name, raw in levels.items():
        text = f"{name}:z" if name in ("dac", "pwm") else f"dio:{name}"
        machine.write(machine.channel(text), raw)


def read(machine: Plant, text: str) -> int:
    return machine.read(machine.channel(text))


def put(machine: Plant, *, z_um: float | None = None, theta_deg: float | None = None) -> None:
    """Carry an axis by hand, and switch the circuits on there."""
    physics = machine.physics
    if z_um is not None:
        physics._qpos[physics._z] = z_um * 1e-6
    if theta_deg is not None:
        physics._qpos[physics._theta] = math.radians(theta_deg)
    physics.power_up()


def drive_to(machine: Plant, target_um: float, ms: int = 800) -> None:
    """A plain PI servo on the truth: enough to bring z somewhere and hold it there."""
    integral = 0.0
    for _ in range(ms):
        error = target_um - machine.z_um
        integral = max(-0.3, min(0.3, integral + 2e-5 * error)) if abs(error) < 1_000 else 0.0
        volts = max(-4.0, min(4.0, 0.004 * error + integral))
        write(machine, dac=round(volts * 204.7))
        machine.advance()


def turn(machine: Plant, steps: int) -> None:
    """So many steps of theta at 100 steps/s, clockwise if positive; then let the rotor settle."""
    write(machine, direction=int(steps > 0))
    machine.advance()
    for _ in range(abs(steps)):
        write(machine, step=1)
        machine.advance(5)
        write(machine, step=0)
        machine.advance(5)
    machine.advance(800)


def deliver(machine: Plant) -> None:
    drive_to(machine, TRANSIT_UM)
    drive_to(machine, TRANSIT_UM)


def grip(machine: Plant, *, ms: int = 100) -> bool:
    """Down on the part, suction on: whether the switch passes."""
    drive_to(machine, PICK_UM)
    write(machine, vacuum=1)
    machine.advance(ms)
    return read(machine, "dio:gripper") == 0


def release(machine: Plant) -> None:
    write(machine, vacuum=0, pressure=1)
    machine.advance(30)
    write(machine, pressure=0)


# Channels and options ------------------------------------------------------------------------------


def test_an_unknown_channel_names_the_nearest_one_and_every_form() -> None:
    with pytest.raises(ChannelError, match=r"did you mean 'counter:theta'.*dac:z, pwm:z"):
        Plant().channel("counter:teta")


@pytest.mark.parametrize(
    "options, message",
    [
        ({"parts": 0}, "parts must be 1 to 6"),
        ({"parts": 7}, "parts must be 1 to 6"),
        ({"preset": 65536}, "16 bits"),
    ],
)
def test_wrong_options_are_errors_of_the_wiring(options: dict[str, object], message: str) -> None:
    with pytest.raises(WiringError, match=message):
        Plant(**options)  # type: ignore[arg-type]


def test_inputs_cannot_be_written_nor_outputs_read() -> None:
    machine = opened()
    with pytest.raises(DriverError, match="counter:z is an input"):
        machine.write(machine.channel("counter:z"), 0)
    with pytest.raises(DriverError, match="tick is an input"):
        machine.write_many([machine.channel("tick")], np.array([1]))
    with pytest.raises(DriverError, match="dac:z is an output"):
        read(machine, "dac:z")
    with pytest.raises(DriverError, match="dac:z is an output"):
        machine.read_many([machine.channel("dac:z")], np.zeros(1, np.int64))


def test_a_line_takes_nothing_but_0_and_1() -> None:
    with pytest.raises(DriverError, match="dio:vacuum takes 0 or 1, not 2"):
        write(opened(), vacuum=2)


def test_nothing_works_before_open() -> None:
    machine = Plant()
    with pytest.raises(DriverError, match="not open"):
        write(machine, vacuum=1)
    with pytest.raises(DriverError, match="not open"):
        machine.advance()
    with pytest.raises(DriverError, match="not open"):
        machine.truth()


def test_without_mujoco_open_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    monkeypatch.delitem(sys.modules, "umo.stations.ztheta.physics", raising=False)
    with pytest.raises(DriverError, match=r'pip install "\.\[plant\]" in the clone of umo'):
        Plant().open()


@pytest.mark.parametrize("period", [0.0015, 0.0004])
def test_a_period_that_is_no_whole_number_of_physics_steps_is_refused(period: float) -> None:
    with pytest.raises(DriverError, match="whole number of ms"):
        opened(period=period)


def test_both_z_drives_together_are_refused_until_the_first_is_finalized() -> None:
    machine = opened()
    dac, pwm = machine.channel("dac:z"), machine.channel("pwm:z")
    machine.initialize(dac, 0)
    with pytest.raises(DriverError, match="only one"):
        machine.initialize(pwm, 0)
    with pytest.raises(DriverError, match="only one"):
        machine.write(pwm, 0)
    machine.finalize(dac)
    machine.initialize(pwm, 0)


def test_block_transfers_move_the_same_levels_as_single_ones() -> None:
    one, many = opened(seed=5), opened(seed=5)
    texts = ["dac:z", "dio:counterweight", "dio:direction", "dio:step"]
    inputs = ["dio:gripper", "adc:counterweight", "counter:z", "counter:theta"]
    out = np.zeros(4, np.int64)
    for k in range(40):
        raws = [k * 10, 1, 1, k % 2]
        for text, raw in zip(texts, raws, strict=True):
            one.write(one.channel(text), raw)
        many.write_many([many.channel(text) for text in texts], np.array(raws))
        one.advance()
        many.advance()
        many.read_many([many.channel(text) for text in inputs], out)
        assert out.tolist() == [read(one, text) for text in inputs]
    assert out[2] > 0


# Time ----------------------------------------------------------------------------------------------


def test_the_tick_lets_one_period_of_physics_pass_and_none_is_ever_missed() -> None:
    machine = opened(period=0.005)
    before = machine.physics.data.time
    assert read(machine, "tick") == 0
    assert machine.physics.data.time - before == pytest.approx(0.005)


def test_the_same_seed_and_writes_give_bitwise_the_same_machine() -> None:
    def run(seed: int) -> bytes:
        machine = opened(seed=seed)
        for k in range(1500):
            write(machine, dac=int(600 * math.sin(k / 100)), step=k // 2 % 2, counterweight=int(k < 800))
            machine.advance()
        return bytes(machine.physics.data.qpos.tobytes() + machine.physics.data.qvel.tobytes())

    assert run(7) == run(7)
    assert run(7) != run(8)


# z: drive, stops, encoder --------------------------------------------------------------------------


def test_without_counterbalance_the_arm_sinks_28_mm_a_second_at_0_volts() -> None:
    machine = opened(seed=SUNK)
    put(machine, z_um=90_000)
    machine.advance(100)
    start = machine.z_um
    machine.advance(500)
    assert (start - machine.z_um) / 0.5 == pytest.approx(28_000, rel=0.03)


@pytest.mark.parametrize("count", [690, 752, 815])
def test_within_the_band_of_pressures_friction_holds_the_arm_at_0_volts(count: int) -> None:
    machine = opened(seed=BALANCED)
    put(machine, z_um=90_000)
    machine.physics.counterbalance.pressure = (count + 0.5) * Counterbalance.COUNT
    machine.advance(100)
    start = machine.z_um
    machine.advance(2000)
    assert abs(machine.z_um - start) < 50


def test_cut_to_0_volts_at_100_mm_a_second_the_arm_stops_within_a_millimetre() -> None:
    machine = opened(seed=BALANCED)
    put(machine, z_um=70_000)
    write(machine, dac=round((3.1416 + 0.0955) * 204.7))
    machine.advance(200)
    start = machine.z_um
    write(machine, dac=0)
    machine.advance(100)
    assert 500 < machine.z_um - start < 750
    rest = machine.z_um
    machine.advance(2000)
    assert abs(machine.z_um - rest) < 20


@pytest.mark.parametrize("sign, stop", [(-1, 54_500), (1, 129_500)])
def test_the_end_stops_hold_the_full_voltage(sign: int, stop: float) -> None:
    machine = opened(seed=BALANCED, faults=["no-courier"])
    write(machine, dac=sign * 2047)
    machine.advance(800)
    assert machine.z_um == pytest.approx(stop, abs=30)


def test_the_z_drives_saturate_and_the_duty_cycle_has_the_other_sign() -> None:
    def after(**level: int) -> float:
        machine = opened(seed=BALANCED)
        put(machine, z_um=60_000)
        write(machine, **level)
        machine.advance(60)
        return machine.z_um

    assert after(dac=2047) == after(dac=9999) == after(pwm=-32767) == after(pwm=-32768)
    assert after(dac=-2047) == after(dac=-2048)
    assert after(pwm=16384) < 60_000 < after(pwm=-16384)


def test_counters_read_0_at_power_up_wherever_the_axes_stand() -> None:
    for seed in range(4):
        machine = opened(seed=seed)
        assert (read(machine, "counter:z"), read(machine, "counter:theta")) == (0, 0)


def test_the_z_counter_counts_whole_lines_and_wraps_below_0() -> None:
    machine = opened(seed=BALANCED)
    start = machine.z_um
    write(machine, dac=-200)
    machine.advance(100)
    line = [math.floor((z + 147_871) / 4.64357) for z in (start, machine.z_um)]
    assert line[1] < line[0]
    assert read(machine, "counter:z") == (line[1] - line[0]) % 65536 > 60_000


def test_a_counter_wraps_at_its_width_in_both_directions() -> None:
    counter = EncoderCounter(resolution=1.0, origin=0.0, index=10**9, preset=0, bits=4, signed=True)
    counter.power_up(100.0)
    seen = []
    for position in (107.9, 108.0, 116.0, 92.0, 91.0):
        counter.follow(position, 0)
        seen.append(counter.raw)
    assert seen == [7, -8, 0, -8, 7]


@pytest.mark.parametrize("start, volts", [(120_000, 200), (124_000, -200)])
def test_passing_the_z_index_loads_the_preset_while_enabled(start: float, volts: int) -> None:
    machine = opened(seed=BALANCED, faults=["no-courier"])
    put(machine, z_um=start)
    write(machine, z_index=1, dac=volts)
    machine.advance(400)
    write(machine, dac=0)
    machine.advance(50)
    assert read(machine, "counter:z") * 4.64357 - 147_871 == pytest.approx(machine.z_um, abs=5)
    assert (machine.z_um - 121_999.4) * volts > 0


def test_the_z_index_does_nothing_unless_enabled_and_the_preset_is_wired() -> None:
    counts = []
    for enabled, preset in ((0, 58117), (1, 58117), (1, 1000)):
        machine = opened(seed=BALANCED, preset=preset)
        put(machine, z_um=120_000)
        write(machine, z_index=enabled, dac=200)
        machine.advance(400)
        counts.append(read(machine, "counter:z"))
    assert counts[0] == pytest.approx((machine.z_um - 120_000) / 4.64357, abs=2)
    assert counts[1] - counts[2] == 58117 - 1000


# theta: steps, encoder, stops ----------------------------------------------------------------------


@pytest.mark.parametrize("steps", [100, -100])
def test_a_step_is_0_225_degrees_and_clockwise_is_positive(steps: int) -> None:
    machine = opened()
    put(machine, theta_deg=10.0)
    machine.advance(1500)
    before, count = machine.theta_deg, read(machine, "counter:theta")
    turn(machine, steps)
    assert machine.theta_deg - before == pytest.approx(0.225 * steps, abs=0.02)
    moved = (read(machine, "counter:theta") - count) * 0.000529483
    assert moved == pytest.approx(machine.theta_deg - before, abs=0.002)


def _steps_taken(machine: Plant, levels: Sequence[tuple[int, int]], *, advance: bool = True) -> int:
    """Steps that the drive makes of (step, direction) levels, each pair written in one transfer."""
    channels = [machine.channel("dio:step"), machine.channel("dio:direction")]
    before = machine.physics.drive._field
    for pair in levels:
        machine.write_many(channels, np.array(pair, np.int64))
        if advance:
            machine.advance()
    machine.advance()
    return round((machine.physics.drive._field - before) / math.radians(0.225))


def _moved_in_c(machine: Plant, texts: Sequence[str], raws: list[int]) -> list[int]:
    """Move these levels by the plant's transfer in C. Returns those of inputs."""
    channels = [machine.channel(text) for text in texts]
    found = machine.in_c(channels, channels[0].direction is Direction.OUTPUT)
    assert not isinstance(found, str), found
    cells = (c_int64 * len(raws))(*raws)
    assert TRANSFER(found.function)(found.context, cells, len(raws)) == 0
    return list(cells)


@pytest.mark.skipif(native is None, reason="the extension in C was not built")
def test_transfers_in_c_move_the_machine_as_those_in_python_do_also_in_turns_with_them() -> None:
    random, one, other = Random(1), opened(), opened()
    texts = ["dac:z", "dio:step", "dio:direction", "dio:counterweight", "dio:vacuum"]
    channels = [one.channel(text) for text in texts]
    inputs = ["counter:z", "counter:theta", "adc:counterweight", "dio:gripper"]
    for machine in (one, other):
        write(machine, dac=0)
    for _ in range(400):
        raws = [random.randint(-900, 900), *(random.randint(0, 1) for _ in texts[1:])]
        one.write_many(channels, np.array(raws))
        if random.random() < 0.8:
            _moved_in_c(other, texts, raws)
        else:
            other.write_many(channels, np.array(raws))
        if random.random() < 0.3:  # an asynchronous actuator, in Python: before the tick, after the transfer
            level = random.randint(0, 1)
            write(one, step=level)
            write(other, step=level)
        one.advance()
        other.advance()
        assert _moved_in_c(other, inputs, [0] * 4) == [read(one, text) for text in inputs]
    assert one.physics.drive._field == other.physics.drive._field


@pytest.mark.skipif(native is None, reason="the extension in C was not built")
def test_transfers_in_c_are_not_offered_for_the_tick_for_inputs_as_outputs_or_before_a_drive_is_initialised() -> None:
    machine = opened()
    assert machine.in_c([machine.channel("tick")], False) == "time passes in Python"
    assert machine.in_c([machine.channel("counter:z")], True) == "time passes in Python"
    assert machine.in_c([machine.channel("dac:z")], True) == "it is not initialised"
    write(machine, dac=0)
    assert not isinstance(machine.in_c([machine.channel("dac:z")], True), str)
    assert machine.in_c([machine.channel("pwm:z")], True) == "it is not initialised"
    assert Plant().in_c([machine.channel("counter:z")], False) == "it is not initialised"


def test_every_rising_edge_is_one_step() -> None:
    assert _steps_taken(opened(), [(0, 1), (1, 1), (1, 1), (0, 1), (0, 1), (1, 1)]) == 2


def test_edges_within_one_physics_step_are_not_lost() -> None:
    assert _steps_taken(opened(), [(0, 1), (1, 1), (0, 1), (1, 1), (0, 1), (1, 1)], advance=False) == 3


def test_a_direction_written_together_with_up_comes_too_late_for_that_step() -> None:
    assert _steps_taken(opened(), [(0, 1), (1, 0)]) == 1
    assert _steps_taken(opened(), [(0, 1), (1, 0), (0, 0), (1, 0)]) == 0


def test_over_driven_the_motor_loses_whole_electrical_cycles_and_the_encoder_shows_it() -> None:
    machine = opened()
    put(machine, theta_deg=-100.0)
    write(machine, direction=1)
    machine.advance(2)
    for level in itertools.islice(itertools.cycle((1, 0)), 800):  # 500 steps/s from standstill
        write(machine, step=level)
        machine.advance()
    machine.advance(1500)
    lost = 400 * 0.225 - read(machine, "counter:theta") * 0.000529483
    assert lost / 7.2 > 5
    assert lost / 7.2 == pytest.approx(round(lost / 7.2), abs=0.03)


@pytest.mark.parametrize("start, steps", [(225.0, 30), (230.0, -30)])
def test_passing_the_theta_index_zeroes_the_count_while_enabled(start: float, steps: int) -> None:
    machine = opened()
    put(machine, theta_deg=start)
    turn(machine, steps)
    assert read(machine, "counter:theta") * steps > 0
    turn(machine, -steps)
    write(machine, theta_index=1)
    turn(machine, steps)
    assert read(machine, "counter:theta") * 0.000529483 + 227.4438 == pytest.approx(machine.theta_deg, abs=0.001)


@pytest.mark.parametrize("sign", [1, -1])
def test_theta_stops_at_271_degrees(sign: int) -> None:
    machine = opened()
    put(machine, theta_deg=sign * 268.0)
    turn(machine, sign * 24)
    assert abs(machine.theta_deg) == pytest.approx(271.0, abs=0.1)


# Pneumatics ----------------------------------------------------------------------------------------


def test_the_counterbalance_fills_through_the_valve_and_leaks_slowly_without_it() -> None:
    machine = opened(seed=SUNK)
    assert read(machine, "adc:counterweight") == 0
    write(machine, counterweight=1)
    machine.advance(1250)
    full = read(machine, "adc:counterweight")
    assert 730 < full < 780
    write(machine, counterweight=0)
    machine.advance(2000)
    assert 4 < full - read(machine, "adc:counterweight") < 12
    write(machine, counterweight=1)
    machine.advance(8000)
    assert 940 < read(machine, "adc:counterweight") <= 950


def pressures(gripper: SuctionCup, ms: int, **levels: int) -> list[float]:
    """The vacuum in kPa after each of so many ms on a part."""
    seen = []
    for _ in range(ms):
        gripper.step(levels.get("valve", 0), levels.get("puff", 0), bool(levels.get("touching", 1)))
        seen.append(gripper.vacuum / 1e3)
    return seen


def test_the_vacuum_lags_by_20_ms_and_the_switch_passes_above_30_kpa() -> None:
    gripper = SuctionCup()
    seen = pressures(gripper, 20, valve=1)
    assert seen[19] == pytest.approx(60 * (1 - math.exp(-1)))
    assert seen[12] < 30 < seen[13]
    assert gripper.raw == 0


def test_the_puff_releases_in_3_ms_and_without_it_the_part_clings() -> None:
    with_puff, without = SuctionCup(), SuctionCup()
    for gripper in (with_puff, without):
        pressures(gripper, 200, valve=1)
    assert pressures(with_puff, 3, puff=1)[-1] == pytest.approx(60 * math.exp(-1), rel=0.01)
    assert with_puff.raw == 1
    assert pressures(without, 100)[-1] > 30
    assert without.raw == 0
    assert pressures(without, 10, touching=0)[-1] < 2


def test_an_open_cup_draws_air_and_holds_nothing() -> None:
    gripper = SuctionCup()
    assert max(pressures(gripper, 300, valve=1, touching=0)) < 10
    assert (gripper.raw, gripper.step(1, 0, False)) == (1, 0.0)


def test_a_part_9_mm_off_centre_is_not_sealed() -> None:
    machine = opened(seed=BALANCED)
    deliver(machine)
    first = machine.physics.parts.places[0]
    machine.physics.data.qpos[first : first + 2] = (0.009, 0.0)
    assert not grip(machine, ms=300)
    assert machine.physics.gripper.vacuum < 10e3


# The courier and the report ------------------------------------------------------------------------


def test_nothing_stands_under_the_cup_until_z_has_risen_above_100_mm() -> None:
    machine = opened(seed=BALANCED)
    write(machine, dac=-400)
    machine.advance(1000)
    assert machine.z_um < 55_000
    deliver(machine)
    assert machine.truth().parts[0].delivered
    write(machine, dac=-400)
    machine.advance(1000)
    assert machine.z_um > 59_000


def test_a_part_is_picked_turned_and_placed_and_then_the_next_one_comes() -> None:
    machine = opened(seed=BALANCED, parts=2)
    deliver(machine)
    for _ in range(2):
        assert grip(machine)
        drive_to(machine, 70_000)
        turn(machine, 400)
        drive_to(machine, PICK_UM)
        release(machine)
        drive_to(machine, 75_000, 500)
        at_work = machine.physics.courier.current
        drive_to(machine, 75_000, 500)
        assert machine.physics.courier.current == at_work  # z is not above 100 mm yet
        drive_to(machine, TRANSIT_UM, 1600)
        assert machine.physics.courier.current == at_work + 1
    report = machine.truth()
    assert report.placed == 2
    for part in report.parts:
        assert part.error_um is not None and part.error_um < courier.TOLERANCE_UM / 10
        assert part.error_deg is not None and part.error_deg < courier.TOLERANCE_DEG / 10
    assert str(report).startswith("part 0: placed, ")


def test_a_part_put_back_without_the_turn_is_not_placed() -> None:
    machine = opened(seed=BALANCED)
    deliver(machine)
    assert grip(machine)
    drive_to(machine, 70_000)
    assert machine.truth().parts[0].lifted
    drive_to(machine, PICK_UM)
    release(machine)
    part = machine.truth().parts[0]
    assert not part.placed and part.error_deg == pytest.approx(90.0, abs=0.5)


def test_the_courier_waits_until_it_is_sure_that_z_is_clear() -> None:
    machine = opened(seed=BALANCED)
    deliver(machine)
    drive_to(machine, PICK_UM)
    drive_to(machine, TRANSIT_UM, 1600)  # up again with nothing lifted
    assert machine.physics.courier.current == 0


# Opening again -------------------------------------------------------------------------------------


def test_after_close_the_machine_runs_on_and_a_second_open_finds_it_there() -> None:
    machine = opened(seed=BALANCED)
    put(machine, z_um=80_000)
    write(machine, dac=400, counterweight=1)
    machine.advance(200)
    write(machine, dac=0, counterweight=0)
    machine.close()
    machine.advance(2000)
    rest = machine.z_um
    assert rest > 85_000
    machine.open()
    assert machine.z_um == rest
    assert read(machine, "counter:z") == 0
