# SPDX-License-Identifier: Apache-2.0
"""Who may see the page."""

import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.monitoring.access import Access, CONTENT_SECURITY_POLICY
from bev_preheat.monitoring.source import asked_of

TOKEN = 'correct-horse-battery'


@pytest.mark.parametrize('address', ['127.0.0.1', '127.8.9.1', '::1', 'localhost'])
def test_a_loopback_address_needs_no_token(address):
    access = Access(address)
    assert not access.needs_token and access.is_session('')


@pytest.mark.parametrize('address', ['0.0.0.0', '::', '192.168.1.7', '10.0.0.1', 'fe80::1'])
def test_any_other_address_does(address):
    with pytest.raises(InvalidInput, match='address: .* not allowed without a token'):
        Access(address)
    access = Access(address, TOKEN)
    assert not access.is_session('') and not access.is_session(TOKEN) and access.is_session(access.session)


@pytest.mark.parametrize('address', ['', 'example.org', '127.0.0.1:80', '999.1.1.1'])
def test_what_is_no_address_is_refused(address):
    with pytest.raises(InvalidInput, match='address: .* must be an IP address'):
        Access(address, TOKEN)


@pytest.mark.parametrize('token, told', [
    ('short', 'has 5 characters'), ('x' * 15, 'has 15 characters'), ('has a space in it!', 'without spaces'),
    ('ümlaut-ümlaut-ümlaut', 'visible ASCII'), ('x' * 257, 'has 257 characters'),
    ('write-your-own-here', 'placeholder'), ('Write-Your-Own-Here', 'placeholder'),
    ('aaaaaaaaaaaaaaaa', 'only 1 different characters'), ('abababAB-ababAB-', 'at least 8'),
    ('correct-horse-correct-horse-', 'repeats'),
    ('0123456789abcdef', 'order'), ('1234567890123456', 'order'), ('zyxwvutsrqponmlk', 'order')])
def test_a_weak_token_is_refused_with_advice_and_not_repeated(token, told):
    with pytest.raises(InvalidInput, match=f'token: .*{told}.*token_urlsafe') as refused:
        Access('0.0.0.0', token)
    assert token not in str(refused.value)


def test_tokens_and_sessions():
    first, second = Access('0.0.0.0', TOKEN), Access('0.0.0.0', TOKEN)
    assert first.is_token(TOKEN)
    assert not any(first.is_token(text) for text in ('', TOKEN[:-1], TOKEN + 'x', 'ümlaut'))
    assert first.session != second.session and not first.is_session('ü')
    # Without a token nothing is one, above all not ''.
    assert not Access('127.0.0.1').is_token('')


@pytest.mark.parametrize('host, is_allowed', [
    ('localhost:8080', True), ('127.0.0.1:8080', True), ('[::1]:8080', True), ('LOCALHOST', True),
    ('evil.example:8080', False), ('127.0.0.1.evil.example', False), ('', False), ('localhost@evil.org', False),
    ('192.168.1.7:8080', False), ('localhost:port', False), ('localhost/x', False)])
def test_on_loopback_only_names_of_this_computer_are_hosts(host, is_allowed):
    assert Access('127.0.0.1').allows_host(host) == is_allowed


@pytest.mark.parametrize('headers, is_same', [
    ({'Host': 'localhost:8080', 'Origin': 'http://localhost:8080'}, True),
    ({'Host': 'localhost:8080', 'Origin': 'http://localhost:8080', 'Sec-Fetch-Site': 'same-origin'}, True),
    ({'Host': 'localhost:8080', 'Origin': 'http://localhost:8080', 'Sec-Fetch-Site': 'cross-site'}, False),
    ({'Host': 'localhost:8080', 'Origin': 'http://localhost:9090'}, False),
    ({'Host': 'localhost:8080', 'Origin': 'https://evil.example'}, False),
    ({'Host': 'localhost:8080', 'Origin': 'null'}, False),
    ({'Host': 'localhost:8080'}, False), ({}, False), ({'Origin': 'http://'}, False)])
def test_only_the_page_itself_may_follow_and_ask(headers, is_same):
    assert Access('127.0.0.1').is_same_origin(headers) == is_same


def test_the_policy_allows_nothing_from_elsewhere():
    assert "default-src 'none'" in CONTENT_SECURITY_POLICY
    assert not any(word in CONTENT_SECURITY_POLICY for word in ('unsafe', 'http', '*'))


@pytest.mark.parametrize('values, named', [
    ([], 'JSON object'), ({}, 'kind'), ({'kind': ['enable']}, 'kind'), ({'kind': 'erase'}, 'kind'),
    ({'kind': 'prepare', 'minutes': -1}, 'minutes: .* 1 ... 1440 min'),
    ({'kind': 'prepare', 'minutes': 1441}, 'minutes'), ({'kind': 'prepare', 'minutes': True}, 'minutes'),
    ({'kind': 'prepare', 'minutes': float('nan')}, 'minutes'), ({'kind': 'prepare', 'minutes': '5'}, 'minutes'),
    ({'kind': 'prepare', 'target': 61}, 'target: .* -60 ... 60 degC'),
    ({'kind': 'prepare', 'pluggedIn': 1}, 'pluggedIn')])
def test_a_bad_request_is_refused_by_field(values, named):
    with pytest.raises(InvalidInput, match=named):
        asked_of(values)
