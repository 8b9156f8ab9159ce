"""A simulated device, with which the driver `my_card` works without the real device.

    python my_card_device.py               listens on TCP, and prints the port
    python my_card_device.py --serial      makes a serial line, and prints its path

adc:0 reads the level of dac:0, and switch:0 that of relay:0. There is no spare:0. The
code of the frames is written again here, and not imported from my_card.py, so that a
mistake in one of the two files does not hide in the other.
"""

from __future__ import annotations

import binascii
import os
import socket
import socketserver
import sys
from collections.abc import Callable

DAC, RELAY, ADC, SWITCH = range(4)
HIGHEST = {DAC: 4095, RELAY: 1, ADC: 4095, SWITCH: 1}
SET = 2
NO_CHANNEL, OUT_OF_RANGE = 1, 2

levels = dict.fromkeys(HIGHEST, 0)


def answer(request: bytes) -> bytes:
    """Return the answer to a whole frame; empty if its checksum is wrong."""
    if int.from_bytes(request[-2:], "big") != binascii.crc_hqx(request[:-2], 0):
        return b""
    body = request[:5]
    for at in range(5, len(request) - 2, 6):
        value = int.from_bytes(request[at + 2 : at + 6], "big", signed=True)
        status, value = carried_out(request[4] == SET, request[at], value)
        body += bytes([request[at], status]) + value.to_bytes(4, "big", signed=True)
    return body + binascii.crc_hqx(body, 0).to_bytes(2, "big")


def carried_out(is_set: bool, place: int, value: int) -> tuple[int, int]:
    """Carry out the request for one channel. Return its status and value."""
    if place not in levels:
        return NO_CHANNEL, 0
    if is_set and (place in (ADC, SWITCH) or not 0 <= value <= HIGHEST[place]):
        return OUT_OF_RANGE, levels[place]
    if is_set:
        levels[place] = levels[ADC if place == DAC else SWITCH] = value
    return 0, levels[place]


def serve(receive: Callable[[], bytes], send: Callable[[bytes], object]) -> None:
    """Answer frames until the connection ends."""
    data = b""
    while more := receive():
        data += more
        while len(data) >= 2:
            end = 2 + int.from_bytes(data[:2], "big")
            if len(data) < end:
                break
            send(answer(data[:end]))
            data = data[end:]


class Client(socketserver.BaseRequestHandler):
    def handle(self) -> None:
        self.request.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        serve(lambda: self.request.recv(4096), self.request.sendall)


class Server(socketserver.ThreadingTCPServer):
    daemon_threads = True

    def handle_error(self, *_: object) -> None:
        """Ignore an error because a client has gone."""


def serve_line() -> None:
    import tty

    device, line = os.openpty()
    tty.setraw(line)
    print(os.ttyname(line), flush=True)
    serve(lambda: os.read(device, 4096), lambda frame: os.write(device, frame))


if __name__ == "__main__":
    if "--serial" in sys.argv:
        serve_line()
    with Server(("127.0.0.1", 0), Client) as server:
        print(server.server_address[1], flush=True)
        server.serve_forever()
