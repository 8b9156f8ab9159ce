"""A bus of the kernel's i2c-stub: each chip is a memory of 256 bytes."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def i2c_bus(*addresses: int, options: tuple[str, ...] = ()) -> Iterator[str]:
    """Its device file. `options`: further ones of the module (Documentation/i2c/i2c-stub.rst)."""
    before = set(Path("/dev").glob("i2c-*"))
    stub = Path(os.environ["UMO_KERNEL_MODULES"]) / "i2c-stub.ko"
    chips = f"chip_addr={','.join(map(hex, addresses))}"
    subprocess.run(["busybox", "insmod", stub, chips, *options], check=True)
    try:
        (made,) = set(Path("/dev").glob("i2c-*")) - before
        yield str(made)
    finally:
        subprocess.run(["busybox", "rmmod", "i2c_stub"], check=True)
