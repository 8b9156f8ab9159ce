"""An axis as the fields of an EPICS motor record (https://github.com/epics-modules/motor)."""

from __future__ import annotations

from collections.abc import Mapping
from math import nan
from typing import Any

from p4p import Value

from umo.clients.faces.epics.epics_variables import EpicsVariables, number_in, number_shown, parts_of, precision_of
from umo.clients.faces.epics.process_variable import CarryOut, ProcessVariable, choice, scalar, undefined
from umo.clients.faces.face import User
from umo.errors import CommandRefused, PathError
from umo.operation.commands.verbs import CALL, CANCEL, LET_GO, TUNE
from umo.process.frames.machine_items import MachineItem

AT_REST = ("disabled", "standstill", "error_stop")
JOG_SHARE = 0.1
"""Velocity of a jog, as a share of the largest velocity."""


class MotorRecord:
    """The fields of one axis: `.VAL` moves, with put completion; `.RBV` is its encoder."""

    def __init__(self, variables: EpicsVariables, axis: Mapping[str, Any]) -> None:
        self._variables, self._axis = variables, axis
        self._path = str(axis["path"])
        self._parts = parts_of(self._path)
        self._name = variables.name_of(self._parts) if self._path else variables.prefix[:-1]
        self._state, self._jog_velocity = "", JOG_SHARE * float(axis["largest"]["velocity"])
        self._acceleration = float(axis["largest"]["acceleration"])
        self._velocity = float(axis["largest"]["velocity"])

    def add(self) -> None:
        axis, items = self._axis, self._variables.machine.by_name
        encoder, state = items[axis["position"]], items[f"axis:{self._path}"]
        self._add_positions(encoder)
        self._add_motion(state)
        self._add_speeds(items)
        self._add_constants(encoder)

    def _field(
        self, name: str, value: Value, write: CarryOut | None = None, *, kept_up: bool = False
    ) -> ProcessVariable:
        variable = ProcessVariable(value, write, kept_up=kept_up)
        self._variables.by_name[f"{self._name}.{name}"] = variable
        return variable

    def _number(self, value: float = nan) -> Value:
        """Return a position or a distance as a scalar in the units of the axis."""
        low, high = float(self._axis["minimum"]), float(self._axis["maximum"])
        return scalar(
            value, units=str(self._axis["units"]), description=f"axis {self._path}", precision=self._precision,
            limitLow=low, limitHigh=high,
        )  # fmt: skip

    def _speed(self, value: float) -> Value:
        high = float(self._axis["largest"]["velocity"])
        return scalar(value, units=f"{self._axis['units']}/s", precision=self._precision, limitHigh=high)

    def _add_positions(self, encoder: MachineItem) -> None:
        self._precision = precision_of(encoder)
        follow, items = self._variables.follow, self._variables.machine.by_name
        readbacks = [self._field(name, undefined(self._number())) for name in ("RBV", "DRBV")]
        targets = [self._field(name, undefined(self._number()), self._move) for name in ("VAL", "DVAL")]
        if (bare := self._name) not in self._variables.by_name:
            targets.append(ProcessVariable(undefined(self._number()), self._move))
            self._variables.by_name[bare] = targets[-1]
        for shown, item in ((readbacks, encoder), (targets, items.get(self._axis["setpoint"], encoder))):
            for variable in shown:
                follow(item, number_shown(variable))
        self._variables.enter((*self._parts, "target"), {"rw": f"{self._name}.VAL"})
        self._variables.enter((*self._parts, "stop"), {"x": f"{self._name}.STOP"})

    def _add_motion(self, state: MachineItem) -> None:
        done, moving = (self._field(name, undefined(scalar(0, "i"))) for name in ("DMOV", "MOVN"))

        def show(value: float, marks: Mapping[str, Any]) -> None:
            self._state = state.states.get(int(value), "") if value == value else ""
            at_rest = int(self._state in AT_REST)
            done.show({"value": at_rest, **marks})
            moving.show({"value": 1 - at_rest, **marks})

        self._variables.follow(state, show)
        self._field("STOP", scalar(0, "i"), self._stop)
        for name, sign in (("JOGF", 1.0), ("JOGR", -1.0)):
            self._field(name, scalar(0, "i"), self._jog(sign), kept_up=True)
        for name in ("HOMF", "HOMR"):
            self._field(name, scalar(0, "i"), self._home)

    def _add_speeds(self, items: Mapping[str, MachineItem]) -> None:
        """Add VELO (the velocity of the axis' profile), ACCL (the time to reach that velocity) and JVEL (the velocity
        of a jog)."""
        velocity, acceleration = (items.get(f"tunable:{self._axis[each]}") for each in ("velocity", "acceleration"))
        speed = self._field("VELO", self._speed(self._velocity), None if velocity is None else self._tune(velocity))
        time = self._field("ACCL", scalar(self._velocity / self._acceleration, units="s", precision=4))
        self._field("JVEL", self._speed(self._jog_velocity))

        def show_time(marks: Mapping[str, Any]) -> None:
            time.show({"value": self._velocity / self._acceleration if self._acceleration else 0.0, **marks})

        def show_velocity(value: float, marks: Mapping[str, Any]) -> None:
            self._velocity = value
            speed.show({"value": value, **marks})
            show_time(marks)

        def show_acceleration(value: float, marks: Mapping[str, Any]) -> None:
            self._acceleration = value
            show_time(marks)

        for item, show in ((velocity, show_velocity), (acceleration, show_acceleration)):
            if item is not None:
                self._variables.follow(item, show)

    def _add_constants(self, encoder: MachineItem) -> None:
        axis, resolution = self._axis, encoder.resolution
        numbers = {
            "HLM": axis["maximum"], "LLM": axis["minimum"], "DHLM": axis["maximum"], "DLLM": axis["minimum"],
            "RDBD": axis["window"], "MRES": resolution, "ERES": resolution, "OFF": 0.0, "UREV": 0.0,
        }  # fmt: skip
        for name, number in numbers.items():
            self._field(name, self._number(float(number)))
        self._field("VMAX", self._speed(float(axis["largest"]["velocity"])))
        for name, whole in {"PREC": self._precision, "SREV": 0, "HLS": 0, "LLS": 0}.items():
            self._field(name, scalar(whole, "i"))
        for name, text in {"EGU": axis["units"], "DESC": f"axis {self._path}", "OUT": "", "RTYP": "motor"}.items():
            self._field(name, scalar(str(text), "s"))
        for name, choices in {"FOFF": ("Variable", "Frozen"), "SET": ("Use", "Set"), "DIR": ("Pos", "Neg")}.items():
            self._field(name, choice(int(name == "FOFF"), choices))

    # Commands ------------------------------------------------------------------------------------------

    def _move(self, user: User, given: Value) -> Any:
        return self._variables.ask(user, CALL.name, self._axis["move"], arguments={"position": number_in(given)})

    def _tune(self, item: MachineItem) -> CarryOut:
        return lambda user, given: self._variables.ask(user, TUNE.name, item.path, value=number_in(given))

    async def _home(self, user: User, given: Value) -> None:
        if self._axis["home"] is None:
            raise CommandRefused(f"{self._path} has no homing")
        await self._variables.ask(user, CALL.name, self._axis["home"], arguments={})

    def _jog(self, sign: float) -> CarryOut:
        async def jog(user: User, given: Value) -> None:
            """Begin a jog if 1 is put, and end it if 0 is put. The jog lasts at most until the channel of this client
            closes."""
            path = self._axis["jog"]
            if number_in(given):
                await self._variables.ask(user, CALL.name, path, arguments={"velocity": sign * self._jog_velocity})
            else:
                await self._variables.ask(user, LET_GO.name, path)

        return jog

    async def _stop(self, user: User, given: Value) -> None:
        """End the moves, homings and jogs that clients have begun. Raises CommandRefused if the application moves the
        axis."""
        axis, ended = self._axis, False
        for do, path in ((CANCEL.name, axis["move"]), (CANCEL.name, axis["home"]), (LET_GO.name, axis["jog"])):
            try:
                if path is not None:
                    await self._variables.ask(user, do, path)
                    ended = True
            except PathError:  # it does not run
                continue
        if not ended and self._state not in (*AT_REST, "stopping"):
            raise CommandRefused(f"{self._path} is moved by the application, and only the end of the run stops it")
