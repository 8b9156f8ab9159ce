"""A running instance of an FMU. The FMU is unpacked into a temporary folder, its library is loaded, and every call of
FMI is checked."""

from __future__ import annotations

import os
import tempfile
import zipfile
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from ctypes import byref, c_size_t, c_void_p
from functools import partial
from itertools import count
from math import isfinite, prod
from pathlib import Path
from typing import Any

import fmpy
from fmpy import fmi2, fmi3
from fmpy.fmi1 import FMICallException
from fmpy.logging import addLoggerProxy

from umo.digits import number_text
from umo.drivers.fmu.variables import FLOATS, INTEGERS, arranged, kind_of, shape_of, variables_of
from umo.errors import DriverError

WARNING, DISCARD, ERROR, FATAL = 1, 2, 3, 4
STATUS = {DISCARD: "discard", ERROR: "error", FATAL: "fatal", 5: "pending"}
LAST_SUCCESSFUL_TIME, TERMINATED = 2, 3
"""Kinds of status in FMI 2.0."""
MAX_MESSAGE_LENGTH = 300
MAX_SHOWN_SIZE, MAX_SHOWN_BYTES = 1_000, 32
"""Largest numbers of elements of an array, and of bytes of a binary, that are shown."""
_logs: dict[int, deque[str]] = {}
_numbers = count(1)


def _log(number: int | None, _name: bytes | None, status: int, _category: bytes | None, message: bytes | None) -> None:
    """Keep a message of an instance if it reports a warning or an error. `number` identifies the instance: it was
    passed to it as its environment. Logging is on, because some models otherwise report no errors; other models then
    report every call."""
    if status >= WARNING and number in _logs:
        _logs[number].append(" ".join((message or b"").decode(errors="replace").split())[:MAX_MESSAGE_LENGTH])


_logger = fmi2.fmi2CallbackLoggerTYPE(_log)
"""The logger of all instances, which is never replaced: FMPy's proxy, which formats the messages of FMI 2.0, has only
one logger."""


class FmuInstance:
    """An instance between initialisation and termination. All errors are DriverErrors with the message of the model."""

    def __init__(self, file: Path, description: Any) -> None:
        self.description = description
        self.time = 0.0
        """Time of the model in s, at the end of the last step."""
        self.lost = ""
        """The reason why the instance cannot be used any more; empty if it can be used."""
        self.ended = False
        """True if the instance cannot be used because the model has requested the end of the simulation."""
        self._status = 0
        """Status of the last call that failed."""
        self._is3 = description.fmiVersion.startswith("3.")
        self._prefix = "fmi3" if self._is3 else "fmi2"
        self._fatal = False
        self._running = False
        self._number = next(_numbers)
        self._log = _logs[self._number] = deque(maxlen=1)
        self._fmu: Any = None
        self._folder = tempfile.TemporaryDirectory(prefix="umo-fmu-", ignore_cleanup_errors=True)
        try:
            self._load(file)
            self._instantiate()
        except BaseException:
            self.close()
            raise

    # Life ----------------------------------------------------------------------------------------

    def start(self, start_values: Mapping[str, float | str]) -> None:
        """Initialise the model with these start values; then the time of the model is its start time."""
        experiment = self.description.defaultExperiment
        self.time = float(experiment.startTime or 0.0) if experiment else 0.0
        tolerance = float(experiment.tolerance) if experiment and experiment.tolerance else None
        if not self._is3:
            self.call(self._fmu.setupExperiment, tolerance, self.time)
        for name, value in start_values.items():
            self._set_start(name, value)
        enter = self._fmu.enterInitializationMode
        self.call(enter, *((tolerance, self.time) if self._is3 else ()))
        self.call(self._fmu.exitInitializationMode)
        self._running = True

    def step(self, start: float, size: float) -> None:
        """Advance the model from `start` to `start + size`, in s."""
        try:
            ended = self.call(self._fmu.doStep, start, size)
        except DriverError:
            if (last := self._ended_by_itself()) is not None:
                raise self._end(last) from None
            raise
        self.time = start + size
        if ended is not None and (ended[1] or ended[2]):  # FMI 3.0: terminateSimulation, earlyReturn
            raise self._end(ended[3])

    def _end(self, time: float) -> DriverError:
        """Record that the model has requested the end of the simulation, and return the error. The model can then only
        be read."""
        self.time, self.ended = time, True
        self.lost = f"the model has ended its simulation at {number_text(time)} s{self._said()}"
        return DriverError(self.lost)

    def _ended_by_itself(self) -> float | None:
        """Return the time that the model has reached if a step was discarded because the model wants to end (FMI 2.0,
        4.2.3); otherwise None."""
        if self._is3 or self._status != DISCARD:
            return None
        ended, last = fmi2.fmi2Boolean(), fmi2.fmi2Real()
        try:
            self._fmu.fmi2GetBooleanStatus(self._fmu.component, TERMINATED, byref(ended))
            if ended.value:
                self._fmu.fmi2GetRealStatus(self._fmu.component, LAST_SUCCESSFUL_TIME, byref(last))
        except FMICallException:  # it is optional
            return self.time if ended.value else None
        return float(last.value) if ended.value else None

    def close(self) -> None:
        """End the instance, unload its library and remove its folder. Calls that FMI forbids after an error are left
        out."""
        try:
            self._let_go_of_python()
            if self._fmu is not None and self._fmu.component and not self._fatal:
                with suppress(Exception):  # it ends whatever the model says
                    if self._running and self.readable:
                        self._fmu.terminate()
                with suppress(Exception):
                    self._fmu.freeInstance()
            elif self._fmu is not None and not self._fatal:
                self._fmu.freeLibrary()
        finally:
            self._fmu = None
            _logs.pop(self._number, None)
            self._folder.cleanup()

    def _let_go_of_python(self) -> None:
        """Finalise the Python interpreter of a PythonFMU library now. Otherwise the library does this when the process
        ends, on memory that C++ destructors have already freed (0.7.0). A second call does nothing."""
        if (function := getattr(getattr(self._fmu, "dll", None), "finalizePythonInterpreter", None)) is not None:
            function()

    # Transfers -----------------------------------------------------------------------------------

    def transfer(self, verb: str, kind: str, references: Sequence[int], buffer: Any) -> Callable[[], object]:
        """Return a call for `call` of the FMI function, such as fmi2GetReal, that gets or sets the values of these
        variables. Its arguments are prepared once, whereas the functions of FMPy convert their arguments in each
        call."""
        name, number = f"{self._prefix}{verb}{kind}", len(references)
        function = self._fmu.dll[name]  # in brackets it is a new one, which shares nothing with FMPy's
        function.errcheck = partial(_check_status, name)
        listed = (self._type("ValueReference") * number)(*references)
        arguments = [c_void_p(self._fmu.component), listed, c_size_t(number), buffer]
        return partial(function, *arguments, *([c_size_t(len(buffer))] if self._is3 else []))

    def buffer(self, kind: str, size: int) -> Any:
        """Return memory for a number of values of a type."""
        return (self._type(kind) * size)()

    def _type(self, name: str) -> Any:
        """Return FMI's own type, such as fmi2Real."""
        return getattr(fmi3 if self._is3 else fmi2, self._prefix + name)

    @property
    def readable(self) -> bool:
        """True if the variables can be read. This is so unless the instance has failed, and also after it has ended."""
        return self.ended or not self.lost

    def value(self, variable: Any) -> Any:
        """Return the present value of a variable, in its unit, as plain data: a list for an array, hexadecimal digits
        for bytes. Return None for a value that is not finite, for a clock, and for an array of more than 1,000 numbers.
        A model that has ended still has its last values."""
        kind = kind_of(self.description, variable)
        shape = shape_of(self.description, variable)
        number = prod(shape)
        if not (kind in FLOATS or kind in INTEGERS or kind in ("String", "Binary")) or number > MAX_SHOWN_SIZE:
            return None
        if not self.readable:
            raise DriverError(self.lost)
        if kind == "Binary":
            read = self._call(self._fmu.getBinary, [variable.valueReference], number)
            return arranged([_hexadecimal(each or b"") for each in read], shape)
        buffer = self.buffer(kind, number)
        self._call(self.transfer("Get", kind, [variable.valueReference], buffer))
        return arranged([_plain(each, kind) for each in buffer], shape)

    def call(self, function: Any, *arguments: Any) -> Any:
        """Make a call of FMI. Raises DriverError if the model refuses the call, has failed earlier or has ended."""
        if self.lost:
            raise DriverError(self.lost)
        return self._call(function, *arguments)

    def _call(self, function: Any, *arguments: Any) -> Any:
        self._log.clear()
        try:
            return function(*arguments)
        except FMICallException as error:
            raise self._failed(error) from error

    def _failed(self, error: FMICallException) -> DriverError:
        status = STATUS.get(error.status, f"status {error.status}")
        text = f"{error.function} at {number_text(self.time)} s: {status}{self._said()}"
        self._fatal, self._status = error.status == FATAL, error.status
        if error.status != DISCARD or error.function.endswith("DoStep"):
            self.lost, self.ended = text, False
        return DriverError(text)

    def _said(self) -> str:
        """Return the model's last message as text to append to an error."""
        return f": {self._log[-1]}" if self._log else ""

    # Loading -------------------------------------------------------------------------------------

    def _load(self, file: Path) -> None:
        name = self.description.coSimulation.modelIdentifier
        platform = fmpy.platform_tuple if self._is3 else fmpy.platform
        with zipfile.ZipFile(file) as archive:
            names = archive.namelist()
        folder, library = f"binaries/{platform}/", f"{name}{fmpy.sharedLibraryExtension}"
        code = [each.removeprefix(folder) for each in names if each.startswith(folder) and not each.endswith("/")]
        if not code:
            raise DriverError(f"{file} has no code for {platform}; it has: {_platforms(names)}")
        if library not in code:
            others = ", ".join(code)
            raise DriverError(f"{file}: its modelIdentifier is {name!r}, but its code for {platform} is {others}")
        here = os.getcwd()
        try:
            fmpy.extract(file, self._folder.name)
            kind = fmi3.FMU3Slave if self._is3 else fmi2.FMU2Slave
            self._fmu = kind(guid=self.description.guid, modelIdentifier=name, unzipDirectory=self._folder.name)
        except Exception as error:  # FMPy's own are plain Exceptions
            raise DriverError(f"{file} cannot be loaded: {error}") from error
        finally:
            os.chdir(here)  # FMPy leaves the folder of a library that cannot be loaded as the current one

    def _instantiate(self) -> None:
        try:
            if self._is3:
                self._fmu.instantiate(loggingOn=True, logMessage=lambda _, *message: _log(self._number, None, *message))
            else:
                callbacks = fmi2.fmi2CallbackFunctions()
                callbacks.logger = _logger
                callbacks.allocateMemory = fmi2.defaultCallbacks.allocateMemory
                callbacks.freeMemory = fmi2.defaultCallbacks.freeMemory
                callbacks.componentEnvironment = self._number
                addLoggerProxy(byref(callbacks))
                self._fmu.instantiate(loggingOn=True, callbacks=callbacks)
        except Exception as error:
            raise DriverError(f"the model could not be instantiated{self._said()}") from error

    def _set_start(self, name: str, value: float | str) -> None:
        variable = variables_of(self.description)[name]
        kind = kind_of(self.description, variable)
        convert = float if kind in FLOATS else (bool if kind == "Boolean" else int) if kind in INTEGERS else str
        self.call(getattr(self._fmu, f"set{kind}"), [variable.valueReference], [convert(value)])


def _check_status(name: str, status: int, *_: object) -> int:
    """Raise FMPy's own error for a call that has failed."""
    if status > WARNING:
        raise FMICallException(function=name, status=status)
    return status


def _plain(value: Any, kind: str) -> float | int | bool | str | None:
    """Return a value of this type, as FMI gives it, as plain data; None if it is not finite."""
    if kind == "String":
        return (value or b"").decode(errors="replace")
    if kind in FLOATS:
        return float(value) if isfinite(value) else None
    return bool(value) if kind == "Boolean" else int(value)


def _hexadecimal(data: bytes) -> str:
    more = f"... ({len(data)} bytes)" if len(data) > MAX_SHOWN_BYTES else ""
    return f"{data[:MAX_SHOWN_BYTES].hex(' ')}{more}"


def _platforms(names: list[str]) -> str:
    found = {name.split("/")[1] for name in names if name.startswith("binaries/") and not name.endswith("/")}
    sources = any(name.startswith("sources/") and name.endswith(".c") for name in names)
    return ", ".join([*sorted(found), *(["C sources (fmpy compile builds them)"] if sources else [])]) or "none"
