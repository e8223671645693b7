"""An emulated plate processor that is served in a thread, and clients that talk to it byte by byte."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from support.drive_tables import vertical_block

from orip.multimodel.link.emulator import Emulator, Patience
from orip.multimodel.link.station import bare_stages
from orip.multimodel.table_step import load_drive_table
from orip.multimodel.table_text import drive_table_text
from orip.web.access import ASKING, stored_token

TABLE = drive_table_text(vertical_block()).encode()
OTHER_TABLE = drive_table_text(vertical_block(rows=1, columns=2)).encode()
IMPATIENT = Patience(download_s=0.3, reading_s=0.5, ending_s=0.5)


def loaded_station(table=TABLE):
    return bare_stages().loaded(table, load_drive_table)


class Raw:
    """A client that sends what it is told, and reads line by line; on a busy machine answers may take long."""

    def __init__(self, port, timeout_s=60.0):
        self.socket = socket.create_connection(("127.0.0.1", port), timeout_s)
        self.lines = self.socket.makefile("rb")
        self.greeting = self.read()
        if self.greeting == ASKING:
            self.greeting = self.ask(f"TOKEN {stored_token('127.0.0.1', port)}")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    @property
    def address(self):
        host, port = self.socket.getsockname()
        return f"{host}:{port}"

    def send(self, data):
        self.socket.sendall(data)

    def read(self):
        return self.lines.readline().decode().rstrip("\n")

    def ask(self, line):
        self.send(line.encode() + b"\n")
        return self.read()

    def close(self):
        self.lines.close()
        self.socket.close()


@contextmanager
def served(station=None, **options) -> Iterator[int]:
    """Serve a station, and yield the port."""
    emulator = Emulator(station or loaded_station(), load_drive_table, **options)
    ready, found = threading.Event(), {}

    async def serve():
        found["loop"], found["end"] = asyncio.get_running_loop(), asyncio.Event()

        def listening(_host, port):
            found["port"] = port
            ready.set()

        await emulator.serve("127.0.0.1", 0, listening, found["end"].wait())

    thread = threading.Thread(target=asyncio.run, args=(serve(),))
    thread.start()
    try:
        assert ready.wait(10.0)
        yield found["port"]
    finally:
        found["loop"].call_soon_threadsafe(found["end"].set)
        thread.join(20.0)
        assert not thread.is_alive()
