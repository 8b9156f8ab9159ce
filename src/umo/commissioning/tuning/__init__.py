"""Tuning of control laws: models of processes from measured responses, gains by known rules, margins, predicted steps.
It needs the extra `tune` (scipy)."""
