"""Laws of xacro files: they expand as the package does; nothing of them is run, nothing is read from elsewhere."""

from pathlib import Path

import numpy as np
import pytest

from ident.errors import RobotError
from ident.robot.arm import ArmModel
from ident.robot.names import example_robots_folder
from ident.robot.xacro_files import expand
from tests.fuzz.guard import Guard
from tests.ident.made_up import joint, link, urdf

NAMESPACE = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
HEAD = f'<robot {NAMESPACE} name="r">'
# What would run, read or leave something: escapes from Python's `eval`, from YAML and XML, as the literature has them.
HARMFUL = {
    "import": "${__import__('os').system('touch RUN')}",
    "classes": "${[c for c in [1] if [b for b in (1).__class__.__mro__]]}",
    "subclasses": "${().__class__.__base__.__subclasses__()}",
    "generator frame": "${[g.gi_frame for g in [(x for x in [1])]][0].f_back.f_globals['os'].system('touch RUN')}",
    "generator throws": "${(x for x in [1]).gi_frame.f_builtins}",
    "coroutine": "${(lambda: (yield))().gi_frame}",
    "lambda": "${(lambda: ().__class__)()}",
    "walrus": "${[y := 1]}",
    "globals of a function": "${sin.__globals__}",
    "self of a function": "${len.__self__}",
    "method of mathematics": "${math.__loader__.load_module('os').system('touch RUN')}",
    "module in a namespace": "${xacro.__class__}",
    "table of symbols": "${python.parent}",
    "root of symbols": "${math.root['python']}",
    "the package's own": "${xacro.load_yaml.__globals__['os'].system('touch RUN')}",
    "message of an error": "${xacro.fatal.__closure__}",
    "format": "${'{0.__class__}'.format(1)}",
    "format of a table": "${'{a.__class__}'.format_map(dict(a=1))}",
    "per cent": "${'%s' % 1}",
    "f-string": "$(eval f'{().__class__}')",
    "format in an f-string": "$(eval f'{1:100}')",
    "getattr": "$(eval getattr(1, '_' + '_class_' + '_'))",
    "exec": "$(eval exec('imp' + 'ort os; os.system(\"touch RUN\")'))",
    "eval": "${eval('1')}",
    "compile": "${compile('1', '', 'eval')}",
    "type": "${type('X', (), dict())}",
    "vars": "${python.vars(xacro)}",
    "map": "${list(map(eval, ['1']))}",
    "method by a table's key": "${dict(a=1).items('__class__')}",
    "mutation": "${dict(a=1).update(b=2)}",
    "key of an object": "${'a'.__class__}",
    "decorated": "${@property}",
    "two statements": "${1; 2}",
    "await": "${await 1}",
    "starred": "${max(*[1, 2])}",
    "double starred": "${dict(**dict(a=1))}",
    "bytes": "${b'a'.decode()}",
    "open": "${open('secret.yaml').read()}",
    "open in eval": "$(eval open('secret.yaml').read())",
    "yaml above": "${xacro.load_yaml('../../secret.yaml')}",
    "yaml of the system": "${xacro.load_yaml('/etc/hostname')}",
    "yaml beside by another way": "${xacro.load_yaml('../urdf/../../secret.yaml')}",
    "linked yaml": "${xacro.load_yaml('link.yaml')}",
    "tag of yaml": "${xacro.load_yaml('tags.yaml')}",
    "unit of yaml": "${xacro.load_yaml('unit.yaml')}",
    "aliases of yaml": "${xacro.load_yaml('bomb.yaml')}",
    "environment": "$(env HOME)",
    "environment in eval": "$(eval env('HOME'))",
    "command": "$(command 'touch RUN')",
    "package above": "$(find ../..)",
    "folder": "$(dirname)",
    "argument as code": "$(eval arg('code').real)",
}
YAML = {
    "tags.yaml": "!!python/object/apply:os.system ['touch RUN']",
    "unit.yaml": "!degrees \"__import__('os').system('touch RUN')\"",
    "bomb.yaml": "a: &a [1, 1]\nb: &b [*a, *a]\n",
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package's urdf folder; above the package a file that is none of its business."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "secret.yaml").write_text("mine: 1")
    (tmp_path / "other.xacro").write_text("<robot/>")
    folder = tmp_path / "pack/urdf"
    folder.mkdir(parents=True)
    (folder / "link.yaml").symlink_to(tmp_path / "secret.yaml")
    for name, text in YAML.items():
        (folder / name).write_text(text)
    (folder / "warm.xacro").write_text(f"{HEAD}<link name=\"${{xacro.load_yaml('size.yaml')}}\"/></robot>")
    (folder / "size.yaml").write_text("1")
    expand(folder / "warm.xacro")  # what is imported is imported here
    return folder


PLACES = (
    '<link name="a {}"/>',
    '<xacro:macro name="part"><link name="{}"/></xacro:macro><xacro:part/>',
    '<xacro:property name="p" value="{}"/><link name="${{p}}"/>',
    '<xacro:if value="{}"/>',
)


@pytest.mark.parametrize("way", HARMFUL)
def test_nothing_of_an_expression_is_run_or_read_from_elsewhere(way: str, folder: Path, guard: Guard) -> None:
    """Law: expressions compute; they reach neither Python nor files outside of the description's package."""
    path, text = folder / "arm.xacro", HARMFUL[way].replace('"', "&quot;")
    for place in PLACES:
        path.write_text(f'{HEAD}<xacro:arg name="code" default="1"/>{place.format(text)}</robot>')
        with guard.watching(), pytest.raises(RobotError, match=r"arm\.xacro: can't be expanded"):
            expand(path)
        assert guard.done + guard.compiled == []
        assert {Path(one).parent for one in guard.read} <= {folder}
    assert not list(folder.parents[1].rglob("RUN"))


ELSEWHERE = {
    "include of the system": '<xacro:include filename="/etc/hostname"/>',
    "include above": '<xacro:include filename="../../other.xacro"/>',
    "pattern of the system": '<xacro:include filename="/etc/host*"/>',
    "pattern of folders": '<xacro:include filename="/*/*/*/*.xacro"/>',
    "process": '<xacro:include filename="/proc/self/environ"/>',
    "include by an expression": "<xacro:include filename=\"${'..' + '/..' + '/other.xacro'}\"/>",
    "external entity": '<!DOCTYPE r [<!ENTITY x SYSTEM "../../secret.yaml">]>{0}<link name="&x;"/>',
    "parameter entity": '<!DOCTYPE r [<!ENTITY % x SYSTEM "../../secret.yaml"> %x;]>{0}',
    "laughs": '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]>{0}<link name="&b;"/>',
}


@pytest.mark.parametrize("way", ELSEWHERE)
def test_no_file_of_another_place_is_opened(way: str, folder: Path, guard: Guard) -> None:
    """Law: what a description includes lies in its package; entities, by which XML names files, are refused."""
    path, text = folder / "arm.xacro", ELSEWHERE[way]
    path.write_text((text.format(HEAD) if "{0}" in text else HEAD + text) + "</robot>")
    with guard.watching(), pytest.raises(RobotError, match=r"outside of its package|entities"):
        expand(path)
    assert guard.read == [str(path)]


ENDLESS = [
    "${9 ** 9 ** 9}",
    "${1.0 ** -17}",
    "${'a' * 10 ** 9}",
    "${10 ** 5 * [0]}",
    "$(eval 10 ** 9 * 'a')",
    "${sum(range(10 ** 10))}",
    "${python.range(10 ** 10)}",
    "${[0 for a in range(9) for b in range(9)]}",
    "${[[0 for a in range(9999)] for b in range(9999)]}",
    "${(lambda f: f(f))(lambda f: f(f))}",
    "${'%1000000000d' % 1}",
    "${'a'.ljust(10 ** 9)}",
    "${('a' * 9999).replace('a', 'a' * 9999)}",
    "${(1).to_bytes(10 ** 9)}",
    "${1 &lt;&lt; 10 ** 9}",
    "${round(5, -10 ** 9)}",
    "${factorial(10 ** 6)}",
    "${" + "(" * 3000 + "1" + ")" * 900 + "}",
    "${" + "-" * 4000 + "1}",
    "${" + "not " * 1000 + "1}",
    "${" + "1+" * 2000 + "1}",
    "${" + "9" * 5000 + "}",
    "${'" + "a" * 30_000 + "'}",
]


@pytest.mark.parametrize("text", ENDLESS, ids=range(len(ENDLESS)))
def test_expressions_without_end_are_refused_before_they_are_computed(tmp_path: Path, text: str) -> None:
    """Law: no expression takes time or memory beyond what a description needs."""
    (tmp_path / "arm.xacro").write_text(f'{HEAD}<link name="{text}"/></robot>')
    with pytest.raises(RobotError, match="can't be expanded"):
        expand(tmp_path / "arm.xacro")


TEXTS = "".join(f'<xacro:property name="g{k + 1}" value="{f"${{g{k}}}" * 9}"/>' for k in range(12))
CALLS = "".join(f'<xacro:macro name="m{k + 1}"><xacro:m{k}/><xacro:m{k}/></xacro:macro>' for k in range(30))
GROWING = {
    "texts": f'<xacro:property name="g0" value="aa"/>{TEXTS}<link name="${{g12}}"/>',
    "macros": f'<xacro:macro name="m0"/>{CALLS}<xacro:m30/>',
    "itself": '<xacro:include filename="arm.xacro"/>',
    "recursion": '<xacro:macro name="again"><xacro:again/></xacro:macro><xacro:again/>',
    "circle": '<xacro:property name="a" value="${b}"/><xacro:property name="b" value="${a}"/><link name="${a}"/>',
    "quotes": f'<xacro:macro name="m" params="a:={"b" * 60}\'"/>',
    "parameters": f'<xacro:macro name="m" params="{"a " * 100_000}"/>',
}


@pytest.mark.parametrize("way", GROWING)
def test_what_grows_or_turns_in_a_circle_is_stopped(way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: neither repeated texts, nor macros or files that name themselves, nor hostile parameters fill memory."""
    monkeypatch.setattr("ident.robot.xacro_files.LONGEST_S", 0.2)
    (tmp_path / "arm.xacro").write_text(f"{HEAD}{GROWING[way]}</robot>")
    if way == "quotes":  # read as the name that it is
        assert expand(tmp_path / "arm.xacro")
        return
    with pytest.raises(RobotError, match="can't be expanded"):
        expand(tmp_path / "arm.xacro")


# In the manner of makers' descriptions: tables from files, macros with blocks and defaults, conditions, prefixes.
PARTS = f"""<robot {NAMESPACE}>
<xacro:macro name="segment" params="name parent config no_prefix:='false' at:='0 0 0.1' prefix:=^|arm_ *shape **more">
  <xacro:property name="own" value="${{'' if no_prefix else prefix}}" lazy_eval="false"/>
  <xacro:property name="z" value="${{at.split(' ')[2]}}"/>
  <link name="${{own}}${{name}}">
    <xacro:if value="${{name in config and 'mass' in config[name]}}">
      <xacro:property name="body" value="${{config[name]}}" lazy_eval="false"/>
      <inertial><origin xyz="${{body.origin.xyz}}"/><mass value="${{body.mass}}"/>
      <inertia ixx="${{body.mass / 12.0 * (3 * body.radius**2 + float(z)**2)}}"
        iyy="${{body['inertia'].yy}}"/></inertial>
    </xacro:if>
    <xacro:unless value="${{name in config}}">${{xacro.warning('none of ' + name)}}<none/></xacro:unless>
    <xacro:insert_block name="shape"/><xacro:insert_block name="more"/>
  </link>
  <joint name="${{own}}${{name}}_joint">
    <origin xyz="${{at}}" rpy="${{pi/2 if 'u' in name else 0}} ${{radians(30)}} ${{-tau}}"/>
  <limit lower="${{limits.lower[0]}}" upper="${{max(limits['lower']) + limits.get('play', 0)}}"
    effort="${{round(2/3, 3)}}"/>
  </joint>
</xacro:macro>
</robot>"""
ROBOT = f"""<?xml version="1.0" encoding="utf-8"?><robot {NAMESPACE} name="r">
<xacro:arg name="name" default="made_up"/><xacro:arg name="twice" default="2"/><xacro:arg name="safe" default="true"/>
<xacro:include filename="$(find makers_description)/urdf/parts.xacro"/>
<xacro:include filename="names.xacro" ns="words"/><xacro:include filename="missing.xacro" optional="true"/>
<xacro:property name="config" value="${{xacro.load_yaml('$(find makers_description)/config/bodies.yaml')}}"/>
<xacro:property name="limits" value="${{xacro.load_yaml('../config/limits.yaml')}}"/>
<xacro:property name="prefix" value="left_"/><xacro:property name="long" default="${{sqrt(2) * $(arg twice)}}"/>
<xacro:segment name="upper" parent="base" config="${{config}}">
  <visual a="${{long}}"/><more><c/><d/></more></xacro:segment>
<xacro:segment name="hand" parent="upper" config="${{config}}" no_prefix="true" at="0 1 ${{2**-2}}">
  <v/><m/></xacro:segment>
<xacro:if value="$(eval twice == 2 and safe)"><a b="$(eval 3 * twice + 1)" c="$(arg safe)"/></xacro:if>
<x a="${{words.first}} ${{math.floor(2.7)}} ${{[k * 2 for k in range(3)][1:]}} ${{7 // 2 % 2}}
  ${{not False}} $${{kept}}"/>
<y a="${{limits.turn}} ${{list(python.zip([1], [2]))}} ${{dict(a=1, b='c')['b']}}
  ${{len('abc') * 1.5}} ${{'a' * 3}} ${{1 &lt; 2 &lt; 3}}"/>
<xacro:element xacro:name="part_${{words.first}}"><xacro:attribute name="k" value="${{str(1.0)}}"/></xacro:element>
</robot>"""


def test_a_makers_description_expands_as_by_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: what is no attack comes out letter by letter as the package gives it, which stays as it was."""
    import xacro
    from xacro import substitution_args

    for name in ("urdf", "config"):
        (tmp_path / name).mkdir()
    (tmp_path / "package.xml").write_text("<package><name>makers_description</name></package>")
    (tmp_path / "urdf/parts.xacro").write_text(PARTS)
    (tmp_path / "urdf/names.xacro").write_text(f'{HEAD}<xacro:property name="first" value="one"/></robot>')
    (tmp_path / "urdf/arm.urdf.xacro").write_text(ROBOT)
    body = "mass: 2.5\n  radius: 0.05\n  origin: {xyz: 0 0 1}\n  inertia: {yy: 0.01}\n"
    (tmp_path / "config/bodies.yaml").write_text(f"upper:\n  {body}")
    (tmp_path / "config/limits.yaml").write_text("lower: [-1.5, 2]\nturn: !degrees 90\n")
    before = dict(vars(xacro)), dict(xacro._global_symbols), dict(xacro._global_symbols["python"])
    found = expand(tmp_path / "urdf/arm.urdf.xacro")
    assert (dict(vars(xacro)), dict(xacro._global_symbols), dict(xacro._global_symbols["python"])) == before
    monkeypatch.setattr(substitution_args, "_eval_find", lambda name: str(tmp_path))
    assert found == xacro.process_file(str(tmp_path / "urdf/arm.urdf.xacro")).toxml()


@pytest.mark.parametrize("name", ["quadrotor_base.xacro", "quadrotor_base.urdf.xacro"])
def test_a_shipped_description_expands_as_by_the_package(name: str, tmp_path: Path) -> None:
    """The xacro files of example-robot-data, macros without a call included."""
    import xacro

    path = next(iter(example_robots_folder().rglob(name)), None)
    if path is None:
        pytest.skip("example-robot-data has it no longer")
    try:
        expected = xacro.process_file(str(path)).toxml()
    except Exception:  # needs a package that is not installed
        with pytest.raises(RobotError, match="can't be expanded"):
            expand(path)
        return
    assert expand(path) == expected


def test_a_xacro_file_is_the_urdf_that_it_expands_to(tmp_path: Path) -> None:
    """Properties and macros are worked out; what can't be expanded is reported with the remedy."""
    plain = urdf(link("a"), link("b"), joint("one", "a", "b"))
    text = plain.replace('<robot name="made_up">', f'<robot name="made_up" {NAMESPACE}>')
    text = text.replace('<link name="a">', '<xacro:property name="m" value="${2 * 3 % 4}"/><link name="a">')
    (tmp_path / "arm.urdf.xacro").write_text(text.replace('value="2.0"', 'value="${m}"'))
    assert 'value="${m}"' in (tmp_path / "arm.urdf.xacro").read_text()
    expected, found = ArmModel.from_urdf(plain), ArmModel.load(tmp_path / "arm.urdf.xacro")
    np.testing.assert_array_equal(found.inertial_parameters, expected.inertial_parameters)
    (tmp_path / "bad.xacro").write_text(text.replace('value="2.0"', 'value="$(arg mass)"'))
    with pytest.raises(RobotError, match=r"can't be expanded.*xacro bad.xacro"):
        ArmModel.load(tmp_path / "bad.xacro")
