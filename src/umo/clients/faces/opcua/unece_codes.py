"""Common codes for units of pint. The codes are those of UN/ECE Recommendation 20, which OPC UA uses for units (OPC
10000-8, 5.6.4.3)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from umo.objects.units import same_unit

NAMESPACE = "http://www.opcfoundation.org/UA/units/un/cefact"
CODES: Mapping[str, str] = {
    "mm": "MMT", "cm": "CMT", "m": "MTR", "km": "KMT", "um": "4H", "nm": "C45", "inch": "INH", "ft": "FOT",
    "mm**2": "MMK", "cm**2": "CMK", "m**2": "MTK", "mm**3": "MMQ", "cm**3": "CMQ", "m**3": "MTQ",
    "L": "LTR", "mL": "MLT", "uL": "4G",
    "s": "SEC", "ms": "C26", "us": "B98", "ns": "C47", "min": "MIN", "hour": "HUR", "day": "DAY",
    "Hz": "HTZ", "kHz": "KHZ", "MHz": "MHZ", "1/s": "C97", "1/min": "C94", "rpm": "RPM",
    "mm/s": "C16", "m/s": "MTS", "m/min": "2X", "km/hour": "KMH", "m/s**2": "MSK", "mm/s**2": "M41",
    "rad": "C81", "mrad": "C25", "degree": "DD", "turn": "M44", "rad/s": "2A", "degree/s": "E96", "rad/s**2": "2B",
    "mg": "MGM", "g": "GRM", "kg": "KGM", "tonne": "TNE", "g/cm**3": "23", "kg/m**3": "KMQ", "kg/s": "KGS",
    "kg/hour": "E93",
    "mN": "C20", "N": "NEW", "kN": "B47", "N*m": "NU", "N*cm": "F88", "kN*m": "B48",
    "Pa": "PAL", "hPa": "A97", "kPa": "KPA", "MPa": "MPA", "mbar": "MBR", "bar": "BAR", "psi": "PS",
    "J": "JOU", "kJ": "KJO", "W*hour": "WHR", "kW*hour": "KWH", "mW": "C31", "W": "WTT", "kW": "KWT",
    "uV": "D82", "mV": "2Z", "V": "VLT", "kV": "KVT", "uA": "B84", "mA": "4K", "A": "AMP",
    "mohm": "E45", "ohm": "OHM", "kohm": "B49", "Mohm": "B75", "F": "FAR", "uF": "4O", "nF": "C41", "pF": "4T",
    "H": "81", "mH": "C14", "uH": "B90", "C": "COU", "T": "D33", "mT": "C29",
    "K": "KEL", "degC": "CEL", "degF": "FAH", "delta_degC": "CEL", "K/s": "F12", "degC/s": "H14",
    "lx": "LUX", "cd": "CDL", "lm": "LUM", "mol": "C34", "mol/L": "C38",
    "percent": "P1", "ppm": "59", "dB": "2N",
    "L/s": "G51", "L/min": "L2", "L/hour": "E32", "m**3/hour": "MQH", "m**3/s": "MQS", "mL/min": "41",
    "count": "C62", "dimensionless": "C62",
}  # fmt: skip
"""The code of each unit."""


@cache
def code_of(unit: str) -> str | None:
    """Return the common code of a unit, or None if no code is known for it."""
    if not unit or unit in CODES:
        return CODES.get(unit)
    return next((code for known, code in CODES.items() if same_unit(unit, known)), None)


def number_of(code: str) -> int:
    """Return the `UnitId` of a code: a number whose bytes are the characters of the code, the first one in the highest
    byte."""
    return int.from_bytes(code.encode("ascii"), "big")
