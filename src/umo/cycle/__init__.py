"""The period of a machine: the process image, conversions, transfers, sequences, the order of the phases, and
connecting and disconnecting. The processes around the loop are in `umo.process`."""
