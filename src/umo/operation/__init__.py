"""What operates a machine: the states and commands of its parts, after PackML and ISA-88.

Recipes are in `umo.operation.recipes` and `umo.operation.recipe_book`.
"""

from umo.operation.model import UnitMode
from umo.operation.packml import PackML, PackMLState
from umo.operation.procedure import Procedure, ProcedureState

__all__ = ["PackML", "PackMLState", "Procedure", "ProcedureState", "UnitMode"]
