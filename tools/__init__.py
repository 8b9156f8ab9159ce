"""Programs for whoever works on umo: pages of the documentation, lints of the tests, mutants."""
