"""Samples of a run against time. This package stores them, reduces them to pixels, measures them, and draws them for
notebooks."""
