"""Makes docs/certificates.md of certificates as JSON.

    python -m pytest tests/conformance --certificates DIR
    python docs/certify.py DIR [DIR...]

The folders hold the certificates of all drivers that the page is to show; those of drivers that are not umo's, and
those that were not tried with every rule, are left out. The tests compare each certificate that they make with its
column (tests/conformance/conftest.py).
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from umo.testing.conformance import Certificate, Judgement, all_rules

PAGE = Path(__file__).with_name("certificates.md")
MARKS = {Judgement.PASSED: "passed", Judgement.FAILED: "**failed**", Judgement.NOT_TRIED: "-"}
OWN = "umo."
HEAD = """# Certificates

What the conformance kit ([how to prove a driver](howto-prove-a-driver.md)) found of the drivers of umo, each with the
counterpart that is named below. `python docs/certify.py DIR` makes this page from the certificates in DIR. A dash: the
rule could not be tried, for the reason that is given below the table.

"""


def page(certificates: Mapping[str, Certificate]) -> str:
    """The whole page; drivers by name."""
    found = [certificates[name] for name in sorted(certificates)]
    parts = [
        HEAD,
        _table(found),
        "\n## Counterparts and times\n\n",
        _times(found),
        "\n## Not tried\n\n",
        _reasons(found),
    ]
    return "".join([*parts, "\n## The rules\n\n", _rules()])


def verdicts(text: str) -> dict[str, dict[str, str]]:
    """The marks of a page: driver, rule, mark."""
    rows = [_cells(line) for line in text.splitlines() if line.startswith("|")]
    names = rows[0][1:]
    known = {rule.id for rule in all_rules()}
    table = {
        row[0]: row[1:] for row in reversed(rows) if row[0] in known and len(row) == len(rows[0])
    }  # the first stays
    return {name: {rule: marks[i] for rule, marks in table.items()} for i, name in enumerate(names)}


def marks(certificate: Certificate) -> dict[str, str]:
    """As they stand in the page."""
    return {each.rule: MARKS[each.verdict] for each in certificate.findings}


def read(folders: Iterable[Path]) -> dict[str, Certificate]:
    """The certificates of the folders by name; of one name the last."""
    files = [file for folder in folders for file in sorted(folder.glob("*.json"))]
    made = [Certificate.from_json(file.read_text("utf-8")) for file in files]
    whole = [each for each in made if each.driver.startswith(OWN) and len(each.findings) == len(all_rules())]
    return {certificate.name: certificate for certificate in whole}


def _table(found: Sequence[Certificate]) -> str:
    """Rules down, drivers across."""
    columns = [marks(certificate) for certificate in found]
    rows = [["rule", *(certificate.name for certificate in found)]]
    rows += [[rule.id, *(column.get(rule.id, "-") for column in columns)] for rule in all_rules()]
    return _markdown(rows)


def _times(found: Sequence[Certificate]) -> str:
    rows = [["driver", "counterpart", "channels", "cycles", "median (p99) per transfer", "date"]]
    for each in found:
        channels = ", ".join((*each.outputs, *each.inputs))
        times = ", ".join(f"{kind} {t.median * 1e6:.0f} ({t.p99 * 1e6:.0f}) us" for kind, t in each.times.items())
        counterpart = ", ".join(each.devices) or "none"
        rows.append([each.name, counterpart, channels, f"{each.cycles:,}", times, each.date])
    return _markdown(rows)


def _reasons(found: Sequence[Certificate]) -> str:
    """Rules with one reason together."""
    lines = []
    for certificate in found:
        reasons: dict[str, list[str]] = {}
        for each in certificate.findings:
            if each.verdict is Judgement.NOT_TRIED:
                reasons.setdefault(each.why, []).append(each.rule)
        lines += [f"- {certificate.name}: {', '.join(rules)}: {why}.\n" for why, rules in reasons.items()]
    return "".join(lines) or "Every rule was tried on every driver.\n"


def _rules() -> str:
    return _markdown([["rule", "what it says"], *([rule.id, rule.text] for rule in all_rules())])


def _markdown(rows: Sequence[Sequence[str]]) -> str:
    lines = [rows[0], ["---"] * len(rows[0]), *rows[1:]]
    return "".join(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |\n" for line in lines)


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def main(arguments: Sequence[str]) -> int:
    found = read(map(Path, arguments))
    if not found:
        print(f"there are no certificates in {' '.join(arguments) or 'no folder'}\n{__doc__}", file=sys.stderr)
        return 2
    PAGE.write_text(page(found), encoding="utf-8")
    print(f"{PAGE.name}: {', '.join(sorted(found))}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
