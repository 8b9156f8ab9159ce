"""Models of FMI 2.0 and 3.0 as plants."""

from umo.drivers.fmu.driver import Fmu

__all__ = ["Fmu"]
