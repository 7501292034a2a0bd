# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Files of RC+ projects (.sprj, .pts, IOLabels.dat, UserErrors.dat): a header and value blocks.

The format was derived from 399 files of 52 public projects. The header is the first line. It
contains the size of the file, in bytes with CR LF as line ends, and a checksum. The checksum is
the XOR of the little-endian 16-bit words in the remaining lines.
"""

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import reduce
from operator import xor

from epson_driver.inputs import InputError, decimal, printable, shown

MAC = '02-00-00-00-00-00'
"""Default for the MAC address in the header. This address is locally administered, so it belongs
to no PC."""

CRLF = '\r\n'
_DEEPEST = 8


class RcFileError(InputError):
    def __init__(self, file: str, line: int, problem: str) -> None:
        super().__init__(f'{printable(file)}:{line}: {problem}')
        self.line = line
        self.problem = problem


@dataclass
class Block:
    """A named block: its keys with their unparsed texts, and its nested blocks, in file order."""

    name: str
    items: list['tuple[str, str] | Block'] = field(default_factory=list)
    file: str = field(default='', compare=False)
    lines: dict[str, int] = field(default_factory=dict, compare=False)
    """Line number of each key in the file. The key '' is the block itself."""

    def blocks(self, prefix: str) -> Iterator['Block']:
        for item in self.items:
            if isinstance(item, Block) and item.name.removeprefix(prefix).isdigit():
                yield item

    def text(self, key: str, usual: str = '') -> str:
        value = self._value(key)
        return usual if value is None else value.removeprefix('"').removesuffix('"')

    def number(self, key: str, usual: float = 0) -> float:
        """Return the value of a key as a number, or `usual` if the key is missing.

        Raises RcFileError if the value is not a number.
        """
        value = self._value(key)
        try:
            return usual if value is None else decimal(value.strip())
        except ValueError:
            raise self.fault(key, f'{key}={shown(value)}: must be a number') from None

    def fault(self, key: str, problem: str) -> RcFileError:
        return RcFileError(self.file, self.lines.get(key, self.lines.get('', 1)), problem)

    def _value(self, key: str) -> str | None:
        result = (item[1] for item in self.items if isinstance(item, tuple) and item[0] == key)
        return next(result, None)


def parsed(name: str, text: str) -> Block:
    """Return a file's content as one block, whose first item is the header, if any.

    Raises RcFileError if the syntax is wrong.
    """
    top = Block('', file=name)
    open_blocks = [top]
    for number, line in enumerate(text.replace(CRLF, '\n').split('\n'), 1):
        message = line.strip('\t ')
        if number == 1 and message.startswith('ENVT'):
            top.items.append(('', line))
        elif message == '}':
            if len(open_blocks) == 1:
                raise RcFileError(name, number, '} without a block')
            open_blocks.pop()
        elif '=' in message:
            key, _, value = message.partition('=')
            open_blocks[-1].items.append((key, value))
            open_blocks[-1].lines.setdefault(key, number)
        elif message.endswith('{') and len(open_blocks) < _DEEPEST:
            block = Block(message[:-1].rstrip(), file=name, lines={'': number})
            open_blocks[-1].items.append(block)
            open_blocks.append(block)
        elif message:
            raise RcFileError(name, number, 'expected key=value, a block or }')
    if len(open_blocks) > 1:
        raise open_blocks[-1].fault('', f'the block {open_blocks[-1].name} has no end: }}')
    return top


def rendered(block: Block) -> str:
    return ''.join(f'{line}{CRLF}' for line in _lines(block, ''))


def _lines(block: Block, indent: str) -> Iterator[str]:
    for item in block.items:
        if isinstance(item, Block):
            yield f'{indent}{item.name} {{'
            yield from _lines(item, indent + '\t')
            yield f'{indent}}}'
        else:
            yield f'{indent}{item[0]}={item[1]}' if item[0] else item[1]


def sealed(body: Block, modified: datetime, mac: str = MAC) -> str:
    text = rendered(body)
    content = text.encode('latin-1')
    stamp = f'{modified.astimezone(UTC):%Y/%m/%d %H:%M:%S}:{modified.microsecond // 1000:03}'

    def header(size: int) -> str:
        end = f'DS:{size:010},CS:{checksum(content):05},MA:{mac},EI:' + ' ' * 11
        return f'ENVT0100,LM:{stamp},{end}{CRLF}'

    return header(len(header(0)) + len(content)) + text


def header_fault(content: bytes) -> str:
    """Return the error in a file's header, or ''. The line ends of `content` may be LF."""
    first, _, rest = content.replace(b'\r\n', b'\n').partition(b'\n')
    result = re.match(rb'ENVT0100,LM:[^,]*,DS:([0-9]{10}),CS:([0-9]{5}),', first)
    if result is None:
        return 'it has no header ENVT0100, so RC+ does not read it'
    body = rest.replace(b'\n', b'\r\n')
    if int(result[1]) != len(first) + 2 + len(body):
        return 'its header has another size'
    return '' if int(result[2]) == checksum(body) else 'its header has another checksum'


def resealed(content: bytes) -> bytes:
    """Return a file's content with correct size and checksum in its header. Line ends are LF."""
    first, _, rest = content.partition(b'\n')
    body = rest.replace(b'\n', b'\r\n')
    numbers = b'DS:%010d,CS:%05d' % (len(first) + 2 + len(body), checksum(body))
    return re.sub(rb'DS:[0-9]{10},CS:[0-9]{5}', numbers, first, count=1) + b'\n' + rest


def checksum(content: bytes) -> int:
    """Return the XOR of the little-endian 16-bit words in `content`."""
    words = struct.iter_unpack('<H', content + b'\0' * (len(content) % 2))
    return reduce(xor, (word for (word,) in words), 0)


def quoted(text: str) -> str:
    """Return a string in the syntax of these files, with doubled backslashes."""
    doubled = text.replace('\\', '\\\\')
    return f'"{doubled}"'
