"""An authority of a fleet in a folder, with the usual certificates."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

from umo.fleet.fleet_certificates import Authority

HOST = "localhost"


def authority_in(folder: Path) -> Authority:
    """Router plant, sites cell7 and cell8, users ann, bob, and eve of cell8 only; `expired` has a certificate of ann
    that was valid until yesterday."""
    authority = Authority.create(folder)
    authority.issue("router", "plant", [HOST])
    for name in ("cell7", "cell8"):
        authority.issue("site", name, [HOST])
    for name in ("ann", "bob"):
        authority.issue("user", name)
    authority.issue("user", "eve", sites=["cell8"])
    past = Authority(folder, datetime.now(UTC) - timedelta(days=30))
    past.issue("user", "late", days=29)
    return authority
