"""The machines that ship with umo, which `umo run NAME` finds here. They use only what is public."""
