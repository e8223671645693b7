"""Addresses to listen on, as every command that serves something takes them: HOST:PORT."""

from __future__ import annotations

import ipaddress
import socket

from orip.errors import UsageError


def listening_address(text: str, otherwise: str | None) -> tuple[str, int]:
    """Return address and port of ``host:port``; port 0: any that is free.

    Parameters
    ----------
    text : str
    otherwise : str or None
        What to do, besides listening on 127.0.0.1, where other machines could reach the address; None: they may.

    Raises
    ------
    UsageError
        If it is no such address, or other machines could reach it and must not.
    """
    host, _, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not host or not (port.isascii() and port.isdecimal() and int(port) <= 65535):
        message = f"'{text}' is not an address to listen on; write HOST:PORT, for example 127.0.0.1:4788"
        raise UsageError(message)
    try:
        found = socket.getaddrinfo(host, int(port), type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        message = f"the host of '{text}' is not known; write for example 127.0.0.1:4788"
        raise UsageError(message) from error
    address = str(found[0][4][0])
    if otherwise is not None and not ipaddress.ip_address(address.partition("%")[0]).is_loopback:
        message = f"{text} can be reached from other machines; listen on 127.0.0.1{otherwise}"
        raise UsageError(message)
    return address, int(port)
