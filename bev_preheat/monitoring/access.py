# SPDX-License-Identifier: Apache-2.0
"""Who may see the page: addresses, token, and the headers by which a browser names the page that asks."""

from __future__ import annotations

from collections.abc import Mapping
from ipaddress import ip_address
import re
import secrets
from urllib.parse import urlsplit

from bev_preheat.errors import InvalidInput, quoted

SHORTEST_TOKEN, LONGEST_TOKEN = 16, 256
TOKEN = re.compile(r'[\x21-\x7e]+')
# The token that docs/how-to/watch.md printed in earlier versions.
PLACEHOLDER = 'write-your-own-here'
LEAST_DIFFERENT = 8
ADVICE = "make one with: python3 -c 'import secrets; print(secrets.token_urlsafe(24))'"
LOOPBACK_NAMES = ('localhost', 'localhost.')
COOKIE = 'bev_preheat_dashboard'
# All that the page needs comes from its own server.
CONTENT_SECURITY_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'self'; frame-ancestors 'none'")
HEADERS = {
    'Content-Security-Policy': CONTENT_SECURITY_POLICY, 'X-Content-Type-Options': 'nosniff',
    'X-Frame-Options': 'DENY', 'Cache-Control': 'no-store',
    # With no-referrer browsers send `Origin: null` with the own form, as they do from foreign frames.
    'Referrer-Policy': 'same-origin',
    'Cross-Origin-Opener-Policy': 'same-origin', 'Cross-Origin-Resource-Policy': 'same-origin'}


class Access:
    """
    Decides on requests.

    On a loopback address the page is for this computer's users: other host names are refused, because another
    site may have had its name resolved to this computer (DNS rebinding). With a token each request needs the
    cookie that the token is exchanged for.
    """

    def __init__(self, address: str, token: str = '') -> None:
        """Raise InvalidInput if the address is invalid, or needs a token, or the token is easy to guess."""
        self.address = '127.0.0.1' if address in LOOPBACK_NAMES else address
        try:
            self.is_loopback = ip_address(self.address).is_loopback
        except ValueError:
            raise InvalidInput(f'address: {quoted(address)} is not allowed; it must be an IP address of this '
                               'computer, or localhost') from None
        if token and not (SHORTEST_TOKEN <= len(token) <= LONGEST_TOKEN and TOKEN.fullmatch(token)):
            # Without the token itself, because messages go to logs.
            raise InvalidInput(f'token: has {len(token)} characters; it must have {SHORTEST_TOKEN} ... '
                               f'{LONGEST_TOKEN} visible ASCII characters, without spaces; {ADVICE}')
        if token and (weakness := weakness_of(token)):
            raise InvalidInput(f'token: {weakness}; {ADVICE}')
        if not self.is_loopback and not token:
            raise InvalidInput(f'address: {address} is not allowed without a token, because others reach it: set '
                               f'token to at least {SHORTEST_TOKEN} characters, or use 127.0.0.1')
        self._token = token
        # Not the token: a cookie is kept by browsers, and ends with this process.
        self.session = secrets.token_urlsafe(32)

    @property
    def needs_token(self) -> bool:
        """Whether a request needs the cookie."""
        return bool(self._token)

    def is_token(self, text: str) -> bool:
        """Return whether a text is the token, in a time that does not depend on the first difference."""
        return self.needs_token and secrets.compare_digest(text.encode(), self._token.encode())

    def is_session(self, cookie: str) -> bool:
        """Return whether a request with this cookie ('' for none) may go on."""
        return not self.needs_token or secrets.compare_digest(cookie.encode(), self.session.encode())

    def allows_host(self, host: str) -> bool:
        """Return whether the header Host names this computer: on loopback, by a name that only means itself."""
        name = host_name(host)
        if name is None:
            return False
        if not self.is_loopback:
            return True
        try:
            return ip_address(name).is_loopback
        except ValueError:
            return name.lower() in LOOPBACK_NAMES

    def is_same_origin(self, headers: Mapping[str, str]) -> bool:
        """Return whether a request that changes or follows something comes from this page itself."""
        if headers.get('Sec-Fetch-Site', 'same-origin') != 'same-origin':
            return False
        origin = urlsplit(headers.get('Origin', ''))
        host = headers.get('Host', '').lower()
        return origin.scheme in ('http', 'https') and host != '' and origin.netloc.lower() == host


def weakness_of(token: str) -> str:
    """Return why a token is easy to guess, as the rest of a sentence without the token; '' if it is not."""
    if token.lower() == PLACEHOLDER:
        return 'is the placeholder of the manual'
    different = len(set(token.lower()))
    if different < LEAST_DIFFERENT:
        return f'has only {different} different characters; it must have at least {LEAST_DIFFERENT}'
    if token in (token + token)[1:-1]:
        return 'repeats one text; it must not'
    rising = sum(abs(ord(after) - ord(before)) == 1 for before, after in zip(token, token[1:]))
    if 2 * rising >= len(token):
        return 'consists of characters in their order, such as 12345678; it must not'
    return ''


def host_name(host: str) -> str | None:
    """Return the name of a header Host without its port; None if it is not one."""
    try:
        parts = urlsplit(f'//{host}')
        # Raises ValueError on a wrong port.
        _ = parts.port
    except ValueError:
        return None
    is_plain = not (parts.path or parts.query or parts.fragment or parts.username or parts.password)
    return parts.hostname if is_plain else None
