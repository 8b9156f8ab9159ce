"""The plug-in under its former name, for environments that were installed before it moved beside the package."""

from umo_pytest import *  # noqa: F403
