"""Translation rests on trees, sums and dicts of a version of Python: on one that it was not tried on it is refused."""

from __future__ import annotations

import pytest

from helpers.side_by_side import HOST, connected_rig
from helpers.written_programs import Program
from umo.generate import translator
from umo.generate.translator import translate


class Plain(Program):
    def control(self) -> None:
        self.k = self.u


def test_another_version_of_python_is_refused_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    with connected_rig() as (rig, _):
        program = Plain(rig)
        assert translate(rig, [], [program.control], HOST).problems == []
        monkeypatch.setattr(translator, "TRIED", ((3, 9), (3, 10)))
        (told,) = map(str, translate(rig, [], [program.control], HOST).problems)
    assert told.startswith("control code: it was tested on Python 3.9, 3.10, and this is 3.")
    assert told.endswith("; use instead: one of these")
