"""Work before a machine goes into service: the timing of a computer is measured (`commissioning.latency`), and laws are
tuned (`commissioning.tuning`). The laws themselves are in `umo.control`."""
