"""The extension in C that writes the body of a frame: body.c."""

from typing import final

from typing_extensions import Buffer

from umo.frames.body import Write

@final
class Body:
    """Holds views of the ring's file and of the image; `size` is that of a body in bytes."""

    def __new__(cls, file: Buffer, values: Buffer, raws: Buffer, quality: Buffer, size: int) -> Body: ...
    @property
    def write(self) -> Write:
        """ValueError unless it is as long as a body, TypeError for a number of another type, OverflowError for one that
        is too great."""
