# SPDX-License-Identifier: BSD-3-Clause
"""What the Python tools share: an error for bad input, its message and exit status, CSV tables.
Standard library only."""

import contextlib
import csv
import os
import struct
import sys

BAD_INPUT, INTERRUPTED = 2, 130  # exit status
# What reading a damaged file may raise.
BAD_CONTENT = (KeyError, ValueError, TypeError, IndexError, AttributeError, ArithmeticError, RecursionError,
               EOFError, csv.Error, struct.error)


class InputError(ValueError):
    """Bad input; the message is one line that names the file."""


def fail(message):
    """The input is at fault."""
    raise InputError(message)


def first_line(error):
    """The first line of an exception's message, or its type."""
    return (str(error).strip() or type(error).__name__).splitlines()[0]


def run(main):
    """Calls main() and ends the program with what it returns. Bad input and files that cannot be read
    or written end it with one line and status 2."""
    name = os.path.basename(sys.argv[0])
    try:
        status = main()
        sys.stdout.flush()
    except InputError as error:
        message, status = error, BAD_INPUT
    except BrokenPipeError:  # the reader of the output has seen enough, e.g. head
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except OSError as error:
        where = f"{os.fsdecode(error.filename)}: " if error.filename else ""
        message, status = f"{where}{error.strerror or error}", BAD_INPUT
    except KeyboardInterrupt:
        message, status = "interrupted", INTERRUPTED
    else:
        sys.exit(status)
    print(f"{name}: {message}", file=sys.stderr)
    sys.exit(status)


@contextlib.contextmanager
def reading(path):
    """What is wrong with a file's content as an InputError that names the file."""
    try:
        yield
    except InputError:
        raise
    except OSError as error:
        fail(f"{path}: {error.strerror or error}")
    except KeyError as error:
        fail(f"{path}: {error} is missing")
    except BAD_CONTENT as error:
        fail(f"{path}: {first_line(error)}")


def read_table(path, columns):
    """Rows of a CSV file as dicts. `columns`: {name: type} of those it must have; they are converted.
    Others stay text."""
    with reading(path), open(path, newline="", encoding="utf-8") as file:
        table = csv.DictReader(file)
        missing = [name for name in columns if name not in (table.fieldnames or ())]
        if missing:
            fail(f"{path}: has no column {missing[0]}")
        rows = []
        for row in table:
            with reading(f"{path}:{table.line_num}"):
                if None in row or None in row.values():
                    fail(f"{path}:{table.line_num}: not {len(table.fieldnames)} fields")
                row.update({name: kind(row[name]) for name, kind in columns.items()})
            rows.append(row)
    return rows


def whole(low):
    """A whole number of at least `low`, for argparse."""
    def whole_number(text):
        value = int(text) if text.isdecimal() and len(text) < 10 else -1
        if value < low:
            raise ValueError
        return value
    whole_number.__name__ = f"whole number from {low}"  # argparse: invalid ... value
    return whole_number
