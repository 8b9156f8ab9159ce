"""Linux Industrial I/O."""

from umo.drivers.iio.driver import Iio

__all__ = ["Iio"]
