"""Stations that ship with umo; `umo run NAME` finds them here."""
