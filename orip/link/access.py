"""Who may use a plate processor that other machines can reach: whoever sends the token of its URL first.

    (greeting)      OK KDPP-EMU 1 TOKEN
    TOKEN t         the greeting of everybody else, or ERR 403 text, and the connection ends

The token keeps others out; it does not keep them from listening: nothing on the line is encrypted.
"""

from __future__ import annotations

import secrets

ASKING = "OK KDPP-EMU 1 TOKEN"
"""What is said first where a token is wanted."""


def new_token() -> str:
    """Return a token that nobody can guess, of letters, digits, '-' and '_'."""
    return secrets.token_urlsafe(16)


def shows_token(line: bytes, token: str) -> bool:
    """Tell whether a request is the right token; how long that takes does not depend on how much of it is right."""
    verb, _, given = line.strip().partition(b" ")
    return secrets.compare_digest(given.strip(), token.encode("ascii")) and verb.upper() == b"TOKEN"
