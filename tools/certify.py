"""Makes docs/certificates.md of certificates as JSON.

    python -m pytest tests/conformance --certificates DIR
    UMO_KERNEL_RESULTS=DIR make test-kernel ARGS="-k contract --certificates DIR"
    python tools/certify.py DIR [DIR...]

The folders hold the certificates of all drivers that the page is to show; those of drivers that are not umo's, and
those that were not tried with every rule, are left out. The tests compare each certificate that they make with the page
(tests/helpers/certificates.py).
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from umo.testing.conformance import Certificate, Judgement, all_rules

PAGE = Path(__file__).parents[1] / "docs" / "certificates.md"
MARKS = {Judgement.PASSED: "passed", Judgement.FAILED: "**failed**", Judgement.NOT_TRIED: "-"}
OWN = "umo."
HEAD = """# Certificates

What the conformance kit ([how to prove a driver](howto-prove-a-driver.md)) found of the drivers of umo. Each
certificate is one way to use a driver, on the counterpart that is named. `python tools/certify.py DIR` makes this page
from the certificates in DIR. Below the table of a driver stands why rules could not be tried ("-").

"""


def page(certificates: Mapping[str, Certificate]) -> str:
    """The whole page: all certificates in brief, then each driver, then the rules."""
    found = [certificates[name] for name in sorted(certificates)]
    parts = [HEAD, _overview(found)]
    for driver in dict.fromkeys(map(driver_of, found)):
        parts.append(f"\n## {driver}\n\n")
        parts.append(_section([each for each in found if driver_of(each) == driver]))
    return "".join([*parts, "\n## The rules\n\n", _rules()])


def driver_of(certificate: Certificate) -> str:
    """The name under which a wiring knows it: the module in umo.drivers."""
    return certificate.driver.removeprefix(OWN + "drivers.").partition(".")[0].partition(":")[0]


def verdicts(text: str) -> dict[str, dict[str, str]]:
    """The marks of a page: certificate, rule, mark."""
    found: dict[str, dict[str, str]] = {}
    names: list[str] = []
    for line in text.partition("\n## The rules\n")[0].splitlines():
        cells = _cells(line) if line.startswith("|") else []
        if cells[:1] == ["rule"]:
            names = cells[1:]
        elif cells and names and cells[0] != "---":
            for name, mark in zip(names, cells[1:], strict=True):
                found.setdefault(name, {})[cells[0]] = mark
        elif not cells:
            names = []
    return found


def marks(certificate: Certificate) -> dict[str, str]:
    """As they stand in the page."""
    return {each.rule: MARKS[each.verdict] for each in certificate.findings}


def read(folders: Iterable[Path]) -> dict[str, Certificate]:
    """The certificates of the folders by name; of one name the last."""
    files = [file for folder in folders for file in sorted(folder.glob("*.json"))]
    made = [Certificate.from_json(file.read_text("utf-8")) for file in files]
    whole = [each for each in made if each.driver.startswith(OWN) and len(each.findings) == len(all_rules())]
    return {certificate.name: certificate for certificate in whole}


def _overview(found: Sequence[Certificate]) -> str:
    rows = [["driver", "certificate", "counterpart", *(verdict.value for verdict in Judgement), "date"]]
    for each in found:
        counts = [str(sum(finding.verdict is verdict for finding in each.findings)) for verdict in Judgement]
        driver = driver_of(each)
        rows.append([f"[{driver}](#{driver})", each.name, ", ".join(each.devices) or "none", *counts, each.date])
    return _markdown(rows)


def _section(found: Sequence[Certificate]) -> str:
    """One driver: its rules down, its certificates across; then why rules were not tried, channels and times."""
    columns = [marks(certificate) for certificate in found]
    rows = [["rule", *(certificate.name for certificate in found)]]
    rows += [[rule.id, *(column.get(rule.id, "-") for column in columns)] for rule in all_rules()]
    return f"{_markdown(rows)}\n{_reasons(found)}{''.join(map(_figures, found))}"


def _reasons(found: Sequence[Certificate]) -> str:
    """Why rules were not tried: those of one reason together."""
    reasons: dict[str, dict[str, list[str]]] = {}
    for certificate in found:
        for each in certificate.findings:
            if each.verdict is Judgement.NOT_TRIED:
                reasons.setdefault(each.why, {}).setdefault(certificate.name, []).append(each.rule)
    return "".join(f"- Not tried: {_by_names(by_name, len(found))}: {why}.\n" for why, by_name in reasons.items())


def _by_names(by_name: Mapping[str, Sequence[str]], number: int) -> str:
    """The rules, with the certificates if it is not the same for all of a driver."""
    alike = len(by_name) == number and len(set(map(tuple, by_name.values()))) == 1
    named = [", ".join(rules) if alike else f"{', '.join(rules)} ({name})" for name, rules in by_name.items()]
    return "; ".join(dict.fromkeys(named))


def _figures(each: Certificate) -> str:
    times = ", ".join(f"{kind} {t.median * 1e6:.0f} ({t.p99 * 1e6:.0f}) us" for kind, t in each.times.items())
    channels = ", ".join(f"`{channel}`" for channel in (*each.outputs, *each.inputs))
    return f"- {each.name}: {channels}; {each.cycles:,} cycles; median (p99) per transfer: {times}.\n"


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
