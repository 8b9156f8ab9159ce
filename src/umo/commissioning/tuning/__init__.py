"""Tuning of control laws: models of processes from measured responses, gains by known rules, margins, predicted steps.
Needs the extra `tune` (scipy)."""
