"""Whether the tests notice defects: single changes of the source, each tried with the tests that reach its line.

    python -m tools.mutants collect                    which test reaches which line: a run of the tests with coverage
    python -m tools.mutants run --count 200            tries mutants; goes on where it was interrupted
    python -m tools.mutants show                       caught, survived

`--tree DIR` tries the tests of another checkout that has a .venv; `run --survivors-of FILE` the mutants that those of
another checkout let pass, as far as the same line exists there. Nothing is changed in the tree: a copy is.
"""
