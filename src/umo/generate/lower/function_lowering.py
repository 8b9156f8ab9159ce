"""Lowers one function. It assigns each expression and statement of Python to the subject that lowers it."""

from __future__ import annotations

import ast
from typing import Any

from umo.generate.function_source import SourcedFunction
from umo.generate.lower.function_builder import CodeContext, FunctionBuilder
from umo.generate.lower.lowered_aliases import LoweredAliases
from umo.generate.lower.lowered_arrays import LoweredArrays
from umo.generate.lower.lowered_assignments import LoweredAssignments
from umo.generate.lower.lowered_attributes import LoweredAttributes
from umo.generate.lower.lowered_branches import LoweredBranches
from umo.generate.lower.lowered_builtins import LoweredBuiltins
from umo.generate.lower.lowered_calls import LoweredCalls
from umo.generate.lower.lowered_choices import LoweredChoices
from umo.generate.lower.lowered_conditions import LoweredConditions
from umo.generate.lower.lowered_errors import LoweredErrors
from umo.generate.lower.lowered_expressions import LoweredExpressions
from umo.generate.lower.lowered_generators import LoweredGenerators, TurnOf
from umo.generate.lower.lowered_loops import LoweredLoops
from umo.generate.lower.lowered_rings import LoweredRings
from umo.generate.lower.lowered_sequences import LoweredSequences
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.lowered_telling import LoweredTexts
from umo.generate.lower.lowered_values import LoweredValues
from umo.generate.lower.lowered_vectors import LoweredVectors


class FunctionLowering(FunctionBuilder):
    """A function with the subjects of its lowering."""

    def __init__(self, world: CodeContext, source: SourcedFunction, key: Any, name: str) -> None:
        super().__init__(world, source, key, name)
        self.values, self.aliases, self.texts = LoweredValues(self), LoweredAliases(self), LoweredTexts(self)
        self.expressions, self.conditions = LoweredExpressions(self), LoweredConditions(self)
        self.arrays, self.vectors = LoweredArrays(self), LoweredVectors(self)
        self.attributes, self.calls, self.builtins = LoweredAttributes(self), LoweredCalls(self), LoweredBuiltins(self)
        self.choices = LoweredChoices(self)
        self.generators, self.rings = LoweredGenerators(self), LoweredRings(self)
        self.assignments, self.branches = LoweredAssignments(self), LoweredBranches(self)
        self.loops, self.sequences, self.errors = LoweredLoops(self), LoweredSequences(self), LoweredErrors(self)
        self.of_expressions = {
            ast.Constant: self.expressions.lower_constant,
            ast.JoinedStr: self.expressions.lower_joined_str,
            ast.Name: self.expressions.lower_name,
            ast.Attribute: self.expressions.lower_attribute,
            ast.Tuple: self.expressions.lower_tuple,
            ast.List: self.expressions.lower_list,
            ast.Dict: self.expressions.lower_dict,
            ast.ListComp: self.sequences.lower_list_comp,
            ast.Subscript: self.expressions.lower_subscript,
            ast.UnaryOp: self.expressions.lower_unary_op,
            ast.BinOp: self.expressions.lower_bin_op,
            ast.Compare: self.conditions.lower_compare,
            ast.BoolOp: self.conditions.lower_bool_op,
            ast.IfExp: self.conditions.lower_if_exp,
            ast.NamedExpr: self.assignments.lower_named_expr,
            ast.Call: self.calls.lower_call,
        }
        self.of_statements = {
            ast.Pass: self.branches.lower_pass,
            ast.Expr: self.branches.lower_expr,
            TurnOf: self.generators.lower_turn,
            ast.FunctionDef: self.branches.lower_function_def,
            ast.Import: self.branches.lower_import,
            ast.ImportFrom: self.branches.lower_import,
            ast.If: self.branches.lower_if,
            ast.Match: self.branches.lower_match,
            ast.Return: self.branches.lower_return,
            ast.Assign: self.assignments.lower_assign,
            ast.AnnAssign: self.assignments.lower_ann_assign,
            ast.AugAssign: self.assignments.lower_aug_assign,
            ast.While: self.loops.lower_while,
            ast.For: self.loops.lower_for,
            ast.Break: self.loops.lower_break,
            ast.Continue: self.loops.lower_continue,
            ast.Raise: self.errors.lower_raise,
            ast.Assert: self.errors.lower_assert,
            ast.Try: self.errors.lower_try,
            ast.With: self.errors.lower_with,
        }

    def end(self) -> None:
        """Release the subjects, so that no reference to the function or to the machine's values remains."""
        for each in vars(self).values():
            if isinstance(each, LoweredSubject):
                del each.f
