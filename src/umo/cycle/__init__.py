"""One period: the process image, conversions, transfers, sequences, what happens when, and connecting and leaving. The
processes around the loop are in `umo.process`."""
