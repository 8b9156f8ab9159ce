"""Modbus devices, on TCP and on serial lines (RTU)."""

from umo.drivers.modbus.channel import ModbusChannel as ModbusChannel
from umo.drivers.modbus.driver import Modbus as Modbus
from umo.drivers.streams import Host as Host
