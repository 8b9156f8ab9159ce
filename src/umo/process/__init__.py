"""The processes of a run: control process, guardians and workers. This package also contains the end of a run, and the
data that a run publishes and receives in shared memory (`process.frames`). The work within a period is in
`umo.cycle`."""
