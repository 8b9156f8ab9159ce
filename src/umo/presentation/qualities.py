"""The quality of a value (`umo.Quality`) as a sign and words, and why it is not good."""

from __future__ import annotations

SIGNS = "●▲◇◔✕"
"""Signs beside the words, where colour alone would not do."""
WORDS = ("good", "out of range", "unreferenced", "stale", "bad")
WHY = (
    "",
    "beyond its range",
    "not homed",
    "the device failed: the last value is held",
    "the device failed, or was not read yet",
)


def quality_text(quality: int, count: int | None = None) -> str:
    """`● good`, `◔ 3 stale`; `count`: of how many of several."""
    return " ".join(filter(None, [SIGNS[quality], "" if count is None else str(count), WORDS[quality]]))
