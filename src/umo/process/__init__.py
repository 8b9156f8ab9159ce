"""The processes of a run: control process, guardians, workers, how a run ends, and what it publishes and receives in
shared memory (`process.frames`). What happens within a period is in `umo.cycle`."""
