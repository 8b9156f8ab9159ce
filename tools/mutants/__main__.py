"""python -m tools.mutants collect | run | show"""

from __future__ import annotations

import argparse
import json
import random
import re
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import tools.mutants
from tools.mutants.copied import Copied
from tools.mutants.mutate import Mutation, mutations
from tools.mutants.reached import PACKAGES, Reached, collect

HERE = Path(__file__).parents[2]
CACHE = Path.home() / ".cache" / "umo" / "mutants"
STEPS = (0.2, 2.0, float("inf"))
"""s that a test takes: the quick ones are tried first."""
QUICK = ["-m", "not full", "-o", "addopts="]


def main() -> int:
    parser = argparse.ArgumentParser("python -m tools.mutants", description=tools.mutants.__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    parser.add_argument("what", choices=["collect", "run", "show"])
    parser.add_argument("--tree", type=Path, default=HERE, help="checkout with a .venv; default: this one")
    parser.add_argument("--folder", type=Path, help="of the copy and the results; default: in ~/.cache/umo/mutants")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=19)
    parser.add_argument("--survivors-of", type=Path, metavar="FILE", help="results.json of another checkout")
    parser.add_argument("--budget", type=float, default=300.0, help="s of tests for one mutant, as once measured")
    given, words = parser.parse_known_args()
    folder: Path = (given.folder or CACHE / given.tree.resolve().name).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    if given.what == "show":
        return show(folder / "results.json")
    copied = Copied(given.tree.resolve(), folder)
    if given.what == "collect":
        (folder / "combined.data").unlink(missing_ok=True)
        print(collect(copied, folder, [*QUICK, "-n", "2", *words]))
        return 0
    return run(copied, folder, given)


def chosen(root: Path, given: argparse.Namespace) -> list[Mutation]:
    """The mutants that are to be tried."""
    files = sorted(str(file.relative_to(root)) for each in PACKAGES for file in (root / "src/umo" / each).rglob("*.py"))
    known = [mutation for file in files for mutation in mutations(root, file)]
    if given.survivors_of is None:
        return random.Random(given.seed).sample(known, min(given.count, len(known)))
    wanted = {key for key, result in read(given.survivors_of).items() if result["verdict"] == "survived"}
    return [mutation for mutation in known if mutation.key in wanted]


def run(copied: Copied, folder: Path, given: argparse.Namespace) -> int:
    reached, results = Reached(folder, copied.root), read(folder / "results.json")
    todo = chosen(copied.root, given)
    for number, mutation in enumerate(todo, 1):
        if mutation.key in results:
            continue
        results[mutation.key] = tried(copied, reached, mutation, given.budget)
        (folder / "results.new").write_text(json.dumps(results, indent=1))
        (folder / "results.new").replace(folder / "results.json")
        result = results[mutation.key]
        print(f"{number}/{len(todo)} {result['verdict']}: {mutation.file}:{mutation.line} {mutation.kind}: "
              f"{mutation.text.splitlines()[0]} {result['by']}", flush=True)  # fmt: skip
    return show(folder / "results.json")


def tried(copied: Copied, reached: Reached, mutation: Mutation, budget: float) -> dict[str, Any]:
    """What the tests say to one mutant."""
    tests, spent = [], 0.0
    for test in reached.tests(mutation.file, mutation.line, mutation.statement):
        spent += reached.seconds[test]
        if spent < budget:
            tests.append(test)
    result = {"file": mutation.file, "line": mutation.line, "kind": mutation.kind, "text": mutation.text, "by": ""}
    if not tests:
        return result | {"verdict": "survived", "by": "no test reaches the line"}
    place = copied.root / mutation.file
    source = place.read_text("utf-8")
    begin = 0.0
    for end in STEPS:
        some = [test for test in tests if begin <= reached.seconds[test] < end]
        while some:
            try:
                place.write_text(mutation.applied(source), "utf-8")
                failing = failed(copied, some, 60 + 10 * sum(reached.seconds[test] for test in some))
            finally:
                place.write_text(source, "utf-8")
            if failing is None:
                break
            if failing not in some or failed(copied, [failing], 600) is None:
                return result | {"verdict": "caught", "by": failing}
            some.remove(failing)  # it fails without the mutant too
        begin = end
    return result | {"verdict": "survived"}


def failed(copied: Copied, tests: list[str], seconds: float) -> str | None:
    """The test that fails first; None if none does."""
    (copied.root / "chosen.txt").write_text("\n".join(tests))
    status, output = copied.pytest(["-x", *QUICK, "--timeout", "60", "@chosen.txt"], seconds)
    if status == 0 or status == 5:
        return None
    named = re.search(r"^(?:FAILED|ERROR) ([^\s\[]+)", output, re.MULTILINE)
    return named[1] if named else "the run itself" if status is not None else "time"


def read(file: Path) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = json.loads(file.read_text()) if file.exists() else {}
    return found


def show(file: Path) -> int:
    results = read(file)
    for key, result in results.items():
        if result["verdict"] == "survived":
            print(f"survived: {result['file']}:{result['line']} {result['kind']}: {key.partition(result['kind'])[2]}"
                  f"  ->  {result['text']}  {result['by']}")  # fmt: skip
    counts = Counter(result["verdict"] for result in results.values())
    print(f"{counts['caught']} of {len(results)} caught, {counts['survived']} survived")
    return 0


if __name__ == "__main__":
    sys.exit(main())
