"""Ways to spoil a file, by what it holds (rows, cells, keys, numbers) and by its bytes; all follow from a generator."""

import io
import json
import re
import zipfile
from collections.abc import Callable

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tests.ident.robot.test_xacro import GROWING, HARMFUL

Rng = np.random.Generator
Spoil = Callable[[bytes, Rng], bytes]

NUMBERS = ["nan", "inf", "-inf", "1e282", "-1e308", "1e-320", "0", "-1", "1e9", "9" * 400, "1.7e9", "0x10", "1,5", ""]
NUMBERS += ["2.443 ", " 2", "2_443", "٢.٤", "２", "+1", "1e", "1d3", "1e-400", "2\n", "2\t"]
TEXTS = ["\x00", "\x1b[31m", '"""', "$(touch RUN)", "[x]", "é\u202e", "a" * 5000, "\n", "../..", "=1+1", "';--", "{}"]
# Numbers of elements in headers of meshes and clouds; names of files in a bag's metadata; schemas of records.
COUNT = re.compile(rb"(?:element \w+ |POINTS |WIDTH |count=\")(\d+)")
FILE_NAME = re.compile(rb"[\w./%-]+\.(?:db3|mcap)")
FILE_NAMES = ["%2e%2e%2frun.db3", "../run.db3", "..", ".", "/etc/passwd", "a?b.db3", "a#b.db3", "metadata.yaml", ""]
FILE_NAMES += ["%2e%2e%2f%2e%2e%2fetc%2fpasswd", "x.db3?mode=rwc", "file:run.db3", "\x00.db3", "run.db3/", "a" * 300]
SCHEMA_NAME = re.compile(rb"(?:ident|plan|armgap)\.\w+/\d+")
SCHEMA_NAMES = ["ident.diagnosis/2", "ident.diagnosis/0", "ident.model/99", "plan.result/1", "ident.fit/1", "none", "1"]
# Of COLLADA: elements that hold no other, what follows a #, and codings.
ELEMENT = re.compile(rb"<(\w+)\b[^<>]*/>|<(\w+)\b[^<>]*>[^<>]*</\w+>")
REFERENCE = re.compile(rb"(?<==\")#?[\w-]+(?=\")")
CODINGS = ["utf-16", "utf-16-le", "utf-16-be", "utf-32", "utf-32-le", "latin-1", "utf-7", "utf-8-sig", "cp037"]
# What TOML writes otherwise than JSON, and what it must not.
TOML_VALUES = ["nan", "-nan", "+inf", "1e400", "-1e-400", "1e308", "0x7fffffffffffffff", "9223372036854775808", "1_000"]
TOML_VALUES += ["1979-05-27T07:32:00Z", "07:32:00", "[[1], [2]]", "[1, 'a']", "{}", "{a = 1, a = 2}", "[{}]", "true"]
TOML_VALUES += ['"\\u0000"', '"\\ud800"', "'''\n'''", "[" * 100 + "]" * 100, "1.0e", "0b2", '""', "[]", "-0.0"]
# Names of joints and links, and letters that make others of them: composed otherwise, unseen, turned round, two-wide.
NAME = re.compile(rb"(?:joint|link|effort|position|base)\w*")
LETTERS = [
    "\u0301",
    "\u200b",
    "\u202e",
    "\uff11",
    "\u00a0",
    "\u212a",
    "\ufeff",
    "\U0001f916",
    "\\",
    "\x7f",
    "/",
    "%",
    "\r",
]
# The value of an attribute or a setting, whole.
ATTRIBUTE = re.compile(rb'="([^"<>]*)"')
SETTING = re.compile(rb"(?m)^\w+ = (.*)$")
# Values that a parser takes, and nobody can mean.
PLAIN = [
    "0",
    "-1",
    "1",
    "1e6",
    "1e-12",
    "-1e9",
    "1e30",
    "3.141592653589793",
    "6.283185307179586",
    "180",
    "57.29577951308232",
]
EXPRESSION = re.compile(rb"\$\{[^}]*\}|\$\([^)]*\)")
# Nobody's description needs any of these; `touch RUN` and the files that are named show what was done.
EXPRESSIONS = ["__import__('os').system('touch RUN')", "[x for x in ().__class__.__bases__[0].__subclasses__()]"]
EXPRESSIONS += ["open('/etc/passwd').read()", "load_yaml('/etc/passwd')", "load_yaml('links.xacro')", "9**9**9"]
EXPRESSIONS += ["2**-0.5", "'a' * 10**9", "[0] * 10**10", "list(range(10**10))", "sum(range(10**10))", "1 << 10**10"]
EXPRESSIONS += ["1 / 0", "nan", "'{0.__class__}'.format(1)", "xacro.load_yaml('x')"]
EXPRESSIONS += ["(lambda f: f(f))(lambda f: f(f))", "half.half", "(", "eval('1')", "getattr(1, 'real')", "'%s' % 1"]
EXPRESSIONS += ["reach if reach else half", "not_there", "1e308 * 10", "inf"]
EXPRESSIONS += ["(" * 500 + ")" * 500, "-" * 5000 + "1", "'x' * 5000", "abs(-reach)", "masses['none']", "f'{reach}'"]
EXPRESSIONS += [text[2:-1].removeprefix("eval ") for text in HARMFUL.values()]
TAGS = ['<xacro:include filename="/etc/passwd"/>', '<xacro:include filename="../../*.xml"/>']
TAGS += ['<xacro:nothing name="a"/>', '<xacro:include filename="arm.xacro"/>']
TAGS += ['<xacro:include filename="links.xacro" ns="a"/>', "<xacro:segment/>"]
TAGS += ['<xacro:include filename="$(find nowhere)/a.xacro"/>', '<xacro:include filename="/dev/zero.xacro"/>']
TAGS += ['<xacro:macro name="again"><xacro:again/></xacro:macro><xacro:again/>', '<xacro:insert_block name="a"/>']
TAGS += ['<xacro:macro name="t" params="*"><xacro:t/><xacro:t/></xacro:macro><xacro:t/>']
TAGS += ['<xacro:call macro="segment"/>', '<xacro:property name="p" value="${p}${p}"/><link name="${p}"/>']
TAGS += ['<xacro:property name="pi" value="3"/>']
TAGS += ['<xacro:property name="a" value="${b}"/><xacro:property name="b" value="${a}"/><link name="${a}"/>']
TAGS += ['<xacro:property name="reach" value="$(env HOME)"/>', '<xacro:element xacro:name="${reach}"/>']
TAGS += ["<xacro:if/>", GROWING["texts"]]
VALUES = [None, True, -1, 1e308, float("nan"), float("inf"), 10**400, "x", [], {}, [[]], "\ud800", "__import__('os')"]


def cut_short(data: bytes, rng: Rng) -> bytes:
    return data[: int(rng.integers(0, len(data) + 1))]


def flip_bytes(data: bytes, rng: Rng) -> bytes:
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 9))):
        if changed:
            changed[int(rng.integers(len(changed)))] = int(rng.integers(256))
    return bytes(changed)


def repeat_part(data: bytes, rng: Rng) -> bytes:
    begin, end = sorted(int(k) for k in rng.integers(0, len(data) + 1, 2))
    return data[:end] + data[begin:end] + data[end:]


def insert_noise(data: bytes, rng: Rng) -> bytes:
    at = int(rng.integers(0, len(data) + 1))
    return data[:at] + rng.bytes(int(rng.integers(1, 64))) + data[at:]


def nothing_left(data: bytes, rng: Rng) -> bytes:
    return b""


def change_cells(data: bytes, rng: Rng) -> bytes:
    """Some cells of a text table become other numbers or texts."""
    lines = data.decode("utf-8", "surrogateescape").split("\n")
    for _ in range(int(rng.integers(1, 6))):
        row = int(rng.integers(len(lines)))
        cells = lines[row].split(",")
        cells[int(rng.integers(len(cells)))] = str(rng.choice(NUMBERS + TEXTS))
        lines[row] = ",".join(cells)
    return "\n".join(lines).encode("utf-8", "surrogateescape")


def change_rows(data: bytes, rng: Rng) -> bytes:
    """Rows are swapped, repeated, dropped."""
    lines = data.split(b"\n")
    for _ in range(int(rng.integers(1, 6))):
        a, b = (int(k) for k in rng.integers(0, len(lines), 2))
        kind = int(rng.integers(3))
        if kind == 0:
            lines[a], lines[b] = lines[b], lines[a]
        elif kind == 1:
            lines.insert(a, lines[b])
        elif len(lines) > 1:
            del lines[a]
    return b"\n".join(lines)


def change_values(data: bytes, rng: Rng) -> bytes:
    """A value of a TOML or XML text becomes another one."""
    text = data.decode("utf-8", "surrogateescape")
    marks = [k for k, letter in enumerate(text) if letter in '="']
    if not marks:
        return data
    at = marks[int(rng.integers(len(marks)))] + 1
    end = at + int(rng.integers(0, 20))
    return (text[:at] + str(rng.choice(NUMBERS + TEXTS)) + text[end:]).encode("utf-8", "surrogateescape")


def change_json(data: bytes, rng: Rng) -> bytes:
    """A value somewhere in a JSON text becomes another one, or goes; or the text nests without end."""
    try:
        record = json.loads(data)
    except (ValueError, RecursionError):
        return flip_bytes(data, rng)
    if rng.random() < 0.05:
        return b'{"a":' * 100_000
    place = record
    while isinstance(place, dict | list) and place:
        keys = list(place) if isinstance(place, dict) else list(range(len(place)))
        key = keys[int(rng.integers(len(keys)))]
        if not isinstance(place[key], dict | list) or not place[key] or rng.random() < 0.3:
            if rng.random() < 0.2:
                del place[key]
            else:
                place[key] = VALUES[int(rng.integers(len(VALUES)))]
            break
        place = place[key]
    try:
        return json.dumps(record).encode()
    except (ValueError, RecursionError):  # an integer too long to be written by Python itself
        return data.replace(b"1", b"9" * 5000, 1)


def change_archive(data: bytes, rng: Rng) -> bytes:
    """An array of an npz becomes one of another shape or kind, or its header lies."""
    try:
        with np.load(io.BytesIO(data)) as archive:
            arrays = {name: archive[name] for name in archive.files}
        name = str(rng.choice(list(arrays)))
    except Exception:
        return flip_bytes(data, rng)
    arrays[name] = np.atleast_1d(arrays[name])
    kinds: list[np.ndarray] = [
        np.zeros(0),
        np.array(3.0),
        np.array(["a"]),
        np.zeros((2, 3, 4)),
        np.full(arrays[name].shape, np.nan) if arrays[name].dtype.kind == "f" else np.arange(3),
        arrays[name][::-1],
        np.array([{}], dtype=object),
        np.zeros(5, dtype=complex),
    ]
    arrays[name] = kinds[int(rng.integers(len(kinds)))]
    packed = io.BytesIO()
    np.savez(packed, **arrays)
    if rng.random() < 0.3:
        return _lie_about_shape(packed.getvalue())
    return packed.getvalue()


def lie_in_footer(data: bytes, rng: Rng) -> bytes:
    """The footer of a Parquet file speaks of another number of values, or of bytes, than there are."""
    length = int.from_bytes(data[-8:-4], "little")
    begin = len(data) - 8 - length
    places = [k for k in range(max(0, begin), len(data) - 9) if data[k] & 128 and not data[k + 1] & 128]
    if begin < 0 or not places:
        return flip_bytes(data, rng)
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 4))):
        at = places[int(rng.integers(len(places)))]
        changed[at] = 128 | int(rng.integers(128))
        changed[at + 1] = int(rng.integers(128))
    return bytes(changed)


def change_table(data: bytes, rng: Rng) -> bytes:
    """A column of a Parquet file becomes one of other values, another kind or another name, goes, or stands twice."""
    try:
        table = pq.ParquetFile(io.BytesIO(data)).read()
        at = int(rng.integers(table.num_columns))
        column, rows = table.column(at), table.num_rows
        values = column.to_pylist()
    except Exception:
        return flip_bytes(data, rng)
    for _ in range(int(rng.integers(1, 4)) if rows else 0):
        values[int(rng.integers(rows))] = [None, np.nan, np.inf, 1e300, -1.7e308, 1e18][int(rng.integers(6))]
    name = table.column_names[int(rng.integers(table.num_columns))]
    columns: list[Callable[[], pa.Table]] = [
        lambda: table.set_column(at, table.column_names[at], pa.array(values)),
        lambda: table.set_column(at, table.column_names[at], pa.nulls(rows, column.type)),
        lambda: table.set_column(at, table.column_names[at], pa.array([[one] for one in values])),
        lambda: table.set_column(at, table.column_names[at], pa.array([str(one) for one in values])),
        lambda: table.set_column(at, name, column),
        lambda: table.remove_column(at),
        lambda: table.slice(0, int(rng.integers(3))),
        lambda: table.take(pa.array(rng.permutation(rows))),
    ]
    try:
        chosen = int(rng.integers(len(columns) + 1))
        table = columns[chosen]() if chosen < len(columns) else _change_meaning(table, rng)
    except (pa.ArrowException, TypeError, ValueError):  # numbers in a column of texts
        table = columns[1]()
    sink = io.BytesIO()
    pq.write_table(table, sink)
    return sink.getvalue()


def _change_meaning(table: pa.Table, rng: Rng) -> pa.Table:
    """A table that is whole and means something else: another unit, a dead channel, one joint alone, a joint twice."""
    names = table.column_names
    kind, at = int(rng.integers(6)), int(rng.integers(len(names)))
    if kind == 0:
        return table.set_column(0, names[0], pa.array((np.asarray(table.column(0)) * 1e9).astype(np.int64)))
    if kind == 1:
        return table.select([name for name in names if name == names[0] or name.startswith("joint_3/")])
    if kind == 2:
        return table.append_column(names[at], table.column(at))
    ending = names[at].rpartition("/")[2]
    for k, name in enumerate(names):
        if name.endswith(f"/{ending}") and (kind != 3 or k == at):
            factor = [float(rng.choice([1e3, 1e9, -1.0])), 0.0, np.nan][kind - 3]
            table = table.set_column(k, name, pa.array(np.asarray(table.column(k), dtype=float) * factor))
    return table


def _lie_about_shape(data: bytes) -> bytes:
    """An array that claims to hold terabytes."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as source, zipfile.ZipFile(out, "w") as target:
        for number, name in enumerate(source.namelist()):
            content = source.read(name)
            if number == 0:
                content = content.replace(b"(", b"(99999999999,", 1)
            target.writestr(name, content)
    return out.getvalue()


def change_header(data: bytes, rng: Rng) -> bytes:
    """The JSON before a safetensors file's weights lies; a weight is no number."""
    size = int.from_bytes(data[:8], "little") if len(data) > 8 else 0
    if not 0 < size < len(data) - 8:
        return flip_bytes(data, rng)
    header, rest = data[8 : 8 + size], bytearray(data[8 + size :])
    kind = int(rng.integers(3))
    if kind == 0:
        header = change_json(header, rng)
    elif kind == 1 and len(rest) > 4:
        at = 4 * int(rng.integers(len(rest) // 4))
        rest[at : at + 4] = np.float32(rng.choice([np.nan, np.inf, 1e30])).tobytes()
    else:
        size = int(rng.integers(2**40))
        return size.to_bytes(8, "little") + header + bytes(rest)
    return len(header).to_bytes(8, "little") + header + bytes(rest)


def nest(data: bytes, rng: Rng) -> bytes:
    """Tables, lists or elements without end."""
    depth = int(rng.integers(100, 20_000))
    ways = (
        b"a = " + b"[" * depth,
        b"a" + b".a" * depth + b" = 1\n",
        b'<robot name="a">' + b"<link>" * depth,
        b'{"a":' * depth,
        b"[" + b"a." * depth + b"a]\n",
    )
    return ways[int(rng.integers(len(ways)))]


def change_chain(data: bytes, rng: Rng) -> bytes:
    """A robot with very many links, one that hangs from itself, or entities that grow."""
    kind, count = int(rng.integers(4)), int(rng.integers(200, 3000))
    if kind == 0:
        mass = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
        links = "".join(f'<link name="l{k}">{mass}</link>' for k in range(count + 1))
        kinds = ("fixed", "revolute")
        joint = '<joint name="j{0}" type="{1}"><parent link="l{0}"/><child link="l{2}"/>{3}</joint>'
        limit = '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/>'
        chosen = kinds[int(rng.integers(2))]
        joints = "".join(joint.format(k, chosen, k + 1, limit) for k in range(count))
        return f'<robot name="long">{links}{joints}</robot>'.encode()
    if kind == 1:
        return data.replace(b"<parent link=", b"<child link=", 1).replace(b"<child link=", b"<parent link=", 1)
    if kind == 2:
        levels = "".join(f'<!ENTITY l{k + 1} "{f"&l{k};" * 10}">' for k in range(12))
        return f'<!DOCTYPE r [<!ENTITY l0 "ha">{levels}]><robot name="&l12;"/>'.encode()
    return b'<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]>' + data.replace(b'name="', b'name="&x;', 1)


def change_expression(data: bytes, rng: Rng) -> bytes:
    """An expression of a xacro file becomes one that runs a program, reads a file, or takes time or memory."""
    found = list(EXPRESSION.finditer(data))
    if not found:
        return data
    one = found[int(rng.integers(len(found)))]
    if rng.random() < 0.3:  # a part of it only
        at = int(rng.integers(one.start(), one.end()))
        return data[:at] + str(rng.choice(EXPRESSIONS)).encode() + data[at:]
    form = b"${%s}" if rng.random() < 0.7 else b"$(eval %s)"
    return data[: one.start()] + form % str(rng.choice(EXPRESSIONS)).encode() + data[one.end() :]


def change_tag(data: bytes, rng: Rng) -> bytes:
    """A tag of xacro's becomes another one, or one that calls itself, includes what it must not, or grows."""
    added = str(rng.choice(TAGS)).encode()
    tags = [k for k in range(len(data)) if data.startswith(b"<", k)]
    if not tags:
        return data
    at = tags[int(rng.integers(len(tags)))]
    if rng.random() < 0.6:
        return data[:at] + added + data[at:]
    names = (b"xacro:include", b"xacro:macro", b"xacro:property", b"xacro:if", b"xacro:arg", b"xacro:segment")
    old, new = (names[int(k)] for k in rng.integers(0, len(names), 2))
    return data.replace(old, new)


def change_words(data: bytes, rng: Rng) -> bytes:
    """Some words of a text become other numbers or texts."""
    words = data.decode("utf-8", "surrogateescape").split(" ")
    for _ in range(int(rng.integers(1, 4))):
        words[int(rng.integers(len(words)))] = str(rng.choice(NUMBERS + TEXTS))
    return " ".join(words).encode("utf-8", "surrogateescape")


def lengthen(data: bytes, rng: Rng) -> bytes:
    """Its lengths or kinds lie: eight bytes become a very large or a negative number, or four of them a small one."""
    if len(data) < 16:
        return data
    at = int(rng.integers(len(data) - 8))
    if rng.random() < 0.5:
        return data[: at // 4 * 4] + int(rng.integers(20)).to_bytes(4, "little") + data[at // 4 * 4 + 4 :]
    number = int(rng.choice([2**31 - 1, 2**32 - 1, 2**40, 2**62, -1]))
    return data[:at] + number.to_bytes(8, "little", signed=True) + data[at + 8 :]


def open_quote(data: bytes, rng: Rng) -> bytes:
    """A quotation mark that nobody closes, somewhere or at the very beginning."""
    at = 0 if rng.random() < 0.2 else int(rng.integers(0, len(data) + 1))
    return data[:at] + b'"' + data[at:]


def change_count(data: bytes, rng: Rng) -> bytes:
    """A header claims another number of elements than follow."""
    found = list(COUNT.finditer(data))
    if not found:
        return data
    one = found[int(rng.integers(len(found)))]
    number = int(rng.choice([0, 1, 1000, 2**31 - 1, 2**32])) if rng.random() < 0.5 else 10 ** int(rng.integers(3, 40))
    return data[: one.start(1)] + str(number).encode() + data[one.end(1) :]


def change_file_name(data: bytes, rng: Rng) -> bytes:
    """A name of a file in a bag's metadata becomes a way out of its folder, or means something to a URI."""
    found = list(FILE_NAME.finditer(data))
    if not found:
        return data
    one = found[int(rng.integers(len(found)))]
    name = str(rng.choice(FILE_NAMES))
    return data[: one.start()] + json.dumps(name).encode() + data[one.end() :]


def change_schema(data: bytes, rng: Rng) -> bytes:
    """Another version or kind of a record of ours."""
    found = list(SCHEMA_NAME.finditer(data))
    if not found:
        return data
    one = found[int(rng.integers(len(found)))]
    kind = str(rng.choice(SCHEMA_NAMES)).encode()
    return data[: one.start()] + kind + data[one.end() :]


def change_toml(data: bytes, rng: Rng) -> bytes:
    """A line of a TOML text stands twice, or holds a date, a table, a number beyond all numbers, or a key of keys."""
    lines = data.split(b"\n")
    at = int(rng.integers(len(lines)))
    key = lines[at].split(b"=")[0].strip() or b"key"
    added = str(rng.choice(TOML_VALUES)).encode()
    ways = (lines[at], key + b" = " + added, key + b".x = " + added, b"[" + key + b"]", b"[[" + key + b"]]")
    ways += (b".".join([key] * 80) + b" = 1",)
    if rng.random() < 0.5:
        lines.insert(at, ways[int(rng.integers(len(ways)))])
    else:
        lines[at] = key + b" = " + added
    return b"\n".join(lines)


def change_whole(pattern: re.Pattern[bytes]) -> Spoil:
    """A spoil: a value is another one as a whole, so that the text stays what its readers can parse."""

    def change(data: bytes, rng: Rng) -> bytes:
        found = list(pattern.finditer(data))
        if not found:
            return data
        one = found[int(rng.integers(len(found)))]
        values = (str(rng.choice(NUMBERS)), str(rng.choice(PLAIN)), f"{rng.normal() * 10.0 ** rng.integers(-9, 10):g}")
        value = values[int(rng.integers(len(values)))].encode()
        words = one.group(1).split()
        if len(words) > 1 and rng.random() < 0.7:  # one number of several
            words[int(rng.integers(len(words)))] = value
            value = b" ".join(words)
        return data[: one.start(1)] + value + data[one.end(1) :]

    return change


def change_letters(data: bytes, rng: Rng) -> bytes:
    """A name becomes one that looks the same, or one that is no name: other alphabets, marks that nobody sees."""
    found = list(NAME.finditer(data))
    if not found:
        return data
    one = found[int(rng.integers(len(found)))]
    name = one.group().decode()
    at = int(rng.integers(len(name)))
    letter = str(rng.choice(LETTERS))
    forms = (name[:at] + letter + name[at:], name[:at] + letter + name[at + 1 :], name.upper(), name + " ", letter)
    new = forms[int(rng.integers(len(forms)))].encode()
    if rng.random() < 0.5:  # everywhere
        return data.replace(one.group(), new)
    return data[: one.start()] + new + data[one.end() :]


def change_places(data: bytes, rng: Rng) -> bytes:
    """An element of a COLLADA file goes, stands twice, or becomes another kind; a name leads to another place."""
    found = list(ELEMENT.finditer(data)) if rng.random() < 0.6 else list(REFERENCE.finditer(data))
    if not found:
        return data
    one, other = (found[int(k)] for k in rng.integers(0, len(found), 2))
    new = (b"", one.group() * 2, other.group())[int(rng.integers(3))]
    return data[: one.start()] + new + data[one.end() :]


def change_coding(data: bytes, rng: Rng) -> bytes:
    """The same text in another coding, with or without the mark that says so."""
    text = data.decode("utf-8", "replace")
    coding = str(rng.choice(CODINGS))
    return text.encode(coding, "replace")


change_attribute = change_whole(ATTRIBUTE)
change_setting = change_whole(SETTING)
MARKUP = (change_attribute, change_attribute, change_attribute, change_letters)
SETTINGS = (change_toml, change_toml, change_setting, change_setting, change_letters)
BYTES: tuple[Spoil, ...] = (cut_short, flip_bytes, repeat_part, insert_noise, nothing_left)
BY_KIND: dict[str, tuple[Spoil, ...]] = {
    "csv": (change_letters, open_quote, change_cells, change_cells, change_cells, change_rows, change_rows, *BYTES),
    "txt": (open_quote, change_words, change_words, change_rows, *BYTES),
    "npz": (change_archive, change_archive, change_archive, lengthen, *BYTES),
    "parquet": (change_table, change_table, change_table, lie_in_footer, lengthen, *BYTES),
    "mcap": (lengthen, lengthen, *BYTES),
    "db3": (lengthen, *BYTES),
    "bag": (lengthen, *BYTES),
    "yaml": (change_file_name, change_file_name, change_words, change_words, change_rows, *BYTES),
    "toml": (
        *SETTINGS,
        change_schema,
        change_values,
        change_values,
        change_values,
        change_rows,
        change_words,
        nest,
        *BYTES,
    ),
    "urdf": (
        *MARKUP,
        change_values,
        change_values,
        change_values,
        change_rows,
        change_chain,
        nest,
        *BYTES,
    ),
    "xacro": (
        *MARKUP,
        change_expression,
        change_expression,
        change_tag,
        change_tag,
        change_values,
        change_chain,
        nest,
        *BYTES,
    ),
    "xml": (
        *MARKUP,
        change_values,
        change_values,
        change_words,
        change_chain,
        nest,
        *BYTES,
    ),
    "dae": (
        *MARKUP,
        change_count,
        change_places,
        change_places,
        change_words,
        change_values,
        change_coding,
        nest,
        *BYTES,
    ),
    "srdf": (
        *MARKUP,
        change_values,
        change_values,
        change_words,
        nest,
        *BYTES,
    ),
    "json": (change_letters, change_schema, change_json, change_json, change_json, change_json, nest, *BYTES),
    "safetensors": (change_header, change_header, change_header, *BYTES),
    "npy": (change_words, lengthen, *BYTES),
    "ply": (change_count, change_count, change_words, change_words, change_rows, lengthen, *BYTES),
    "pcd": (change_count, change_count, change_words, change_words, change_rows, lengthen, *BYTES),
    "stl": (change_words, change_words, change_rows, lengthen, *BYTES),
    "obj": (change_words, change_words, change_rows, *BYTES),
    "py": (change_words, change_rows, *BYTES),
}
