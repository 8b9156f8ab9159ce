"""Do readers of shared memory take for whole only what was written as a whole, on x86-64 and on ARM?

The threads of a model are the functions of umo themselves. Each runs on a memory that stops at a load, and is run again
with each value that the load may return there (`threads`). Which values these are, two machines say (`machines`):
x86-64 with its store buffers (TSO), and ARM, where stores become visible in any order and loads return any value that
is not older than what the same thread has seen at that place. All orders are tried (`explore`); writers may be killed
between any two stores. `worker_protocols`, `frame_protocols` and `client_protocols` have what is modelled and what must
hold, `mutants` the protocols with one step left out or swapped: the checker has to find each.

What is assumed: aligned words of 8 bytes are loaded and stored at once; a copy of more is made word by word in any
order (a frame's body is two halves); a lock and a wait are fences; a store that depends on a load is not made before
it, and all of the stores here that follow loads depend on them (their number, their place or whether they are made at
all). After a wait (`pause`: a period, the time between two looks) everything is visible that was stored before it.
"""
