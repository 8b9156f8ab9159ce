"""Samples of a run against time: the room stores them, reduces them to pixels, measures them, and draws them for
notebooks."""
