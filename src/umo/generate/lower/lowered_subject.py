"""One subject of the lowering of a function."""

from __future__ import annotations

from umo.generate.lower.function_builder import FunctionBuilder


class LoweredSubject:
    """One subject of the lowering of a function, such as its loops. `f` is the function, which has the other
    subjects."""

    def __init__(self, f: FunctionBuilder) -> None:
        self.f = f
