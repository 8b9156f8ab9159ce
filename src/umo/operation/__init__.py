"""The functions of a machine for its operators: the states of its parts (PackML, ISA-88), recipes, alarms (ISA-18.2),
and the commands from outside with roles and lease (`operation.commands`). The clients that send these commands are in
`umo.clients`."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from umo.operation.model import UnitMode
    from umo.operation.packml import PackML, PackMLState
    from umo.operation.procedure import Procedure, ProcedureState

__all__ = ["PackML", "PackMLState", "Procedure", "ProcedureState", "UnitMode"]

_MODULES = {
    "PackML": "packml",
    "PackMLState": "packml",
    "Procedure": "procedure",
    "ProcedureState": "procedure",
    "UnitMode": "model",
}


def __getattr__(name: str) -> Any:
    """Import each name when it is first used (PEP 562), because programs that read alarms or send commands need none of
    these names."""
    if name not in _MODULES:
        raise AttributeError(f"module 'umo.operation' has no attribute {name!r}")
    found = globals()[name] = getattr(import_module(f"umo.operation.{_MODULES[name]}"), name)
    return found
