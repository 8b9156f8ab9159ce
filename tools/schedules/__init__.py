"""Schedules of the stop: the real processes of a run, one at a time, in every order, with every fault.

This is no part of `umo.testing`: it tests the processes of umo itself, and nothing of a user's. `python -m
tools.schedules --help` has examples; /work/shared/notes/schedules.md is the study behind it.

A world is one run: starter, guardian, control process, standby guardian, reset process, worker. Each process is a real
one and its code is unchanged, but the functions of `umo.system.calls` are replaced (`gate`): before each call that
others can observe, the process stands at its gate and waits. The scheduler lets one go on at a time; it has the clock
of all of them, and kills, stops and holds up a process that stands at its gate. So a run is determined by a number, its
seed, and by the list of its faults, and is the same whenever it is played.
"""
