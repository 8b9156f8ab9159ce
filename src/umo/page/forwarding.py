"""Where a command of a page is handed on."""

from __future__ import annotations

from typing import Any

from umo.page.watched import Watched

READ_ONLY = "this page is read-only"


async def carry_out(message: dict[str, Any], watched: Watched | None, hands: bool) -> dict[str, Any]:
    """The answer to a command: `{"state": "refused", "text": ...}`. `hands`: this server lets pages command."""
    return {"state": "refused", "text": READ_ONLY}
