"""The machines that ship with umo, which `umo run NAME` finds here. They use only the public interface of umo."""
