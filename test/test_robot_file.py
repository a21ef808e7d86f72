"""Files of strangers as one text: what they include, and what is refused in one line."""

import os

import pytest
from machine_files import INERTIAL, five_bar, joint, link, mjcf

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import robot_file
from parallel_robot_model.configuration.robot_file import text_of

HINGE = f'<body><joint name="j"/>{INERTIAL.format(0, 1)}</body>'
BOMB = '<!DOCTYPE m [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><mujoco>&b;</mujoco>'
FILE = '<!DOCTYPE m [<!ENTITY a SYSTEM "/etc/passwd">]><mujoco>&a;</mujoco>'


@pytest.fixture
def write(tmp_path):
    def write(text, name='robot.xml'):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def test_what_needs_files_and_what_is_for_the_eye_is_dropped(write):
    body = (
        f'<body name="b"><joint/><!-- a hinge -->{INERTIAL.format(0, 1)}'
        '<geom mesh="m" type="mesh"/><frame><geom size="1"/></frame><camera/></body>'
        '<body name="c"><geom size="1"/></body>'
    )
    text = text_of(write(mjcf(body, '<asset><mesh name="m" file="m.stl"/></asset>')))
    root = robot_file.parse_xml(text, 'text')
    assert [node.tag for node in root.iter()] == [
        'mujoco', 'worldbody', 'body', 'joint', 'inertial', 'frame', 'body', 'geom',
    ]  # fmt: skip
    assert root.find('worldbody/body').attrib == {'name': 'b'}


def test_elements_stay_on_their_lines(write):
    text = text_of(write('<mujoco>\n<asset>\n</asset>\n\n<worldbody>\n<body name="x"/>\n\n'
                         '</worldbody><equality/></mujoco>'))  # fmt: skip
    body = robot_file.parse_xml(text, 'text').find('worldbody/body')
    assert body.line == 6 and body.place == 'text, line 6'


def test_special_characters_survive(write):
    name = "a&lt;b&gt; &amp; &quot;c&quot; 'd' é &#10;"
    root = robot_file.parse_xml(text_of(write(f'<robot name="{name}"/>')), 'text')
    assert root.get('name') == 'a<b> & "c" \'d\' é \n'


def test_files_are_included_from_the_folder(write):
    write(f'<mujocoinclude>{HINGE}</mujocoinclude>', 'parts/leg.xml')
    write('<mujoco><option gravity="0 0 0"/></mujoco>', 'options.xml')
    world = '<frame><include file="parts/leg.xml"/></frame>'
    text = text_of(write(mjcf(world, '<include file="options.xml"/>')))
    root = robot_file.parse_xml(text, 'text')
    assert root.find('worldbody/frame/body/joint').get('name') == 'j'
    assert root.find('option') is not None and root.find('include') is None
    assert root.find('option').place == 'text'  # the line would be that of another file


@pytest.mark.parametrize('name', ['../leg.xml', '/etc/passwd', 'a/../../leg.xml', '', 'a\\b.xml'])
def test_no_file_outside_the_folder_is_read(write, name):
    path = write(mjcf(f'\n<include file="{name}"/>'))
    with pytest.raises(InputError, match=r'line 2: <include> file=.* in the folder of'):
        text_of(path)


def test_links_out_of_the_folder_are_not_followed(write, tmp_path):
    outside = write('<mujoco/>', 'outside/secret.xml')
    (tmp_path / 'robot').mkdir()
    (tmp_path / 'robot' / 'leg.xml').symlink_to(outside)
    path = write(mjcf('<include file="leg.xml"/>'), 'robot/robot.xml')
    with pytest.raises(InputError, match='leads out of the folder'):
        text_of(path)


def test_circles_of_files_end(write):
    write('<mujoco><include file="b.xml"/></mujoco>', 'a.xml')
    write('<mujoco><include file="a.xml"/></mujoco>', 'b.xml')
    with pytest.raises(InputError, match=r"a.xml, line 1: <include> file='b.xml'|included twice"):
        text_of(write('<mujoco><include file="a.xml"/></mujoco>'))
    with pytest.raises(InputError, match='included twice'):
        text_of(write('<mujoco><include file="robot.xml"/></mujoco>'))
    with pytest.raises(InputError, match=r'gone.xml does not exist'):
        text_of(write('<mujoco><include file="gone.xml"/></mujoco>'))


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        (BOMB, 'line 1: a robot needs no DOCTYPE'),
        (FILE, 'line 1: a robot needs no DOCTYPE'),
        ('<mujoco><a>&b;</a></mujoco>', 'line 1: not valid XML: undefined entity'),
        ('<mujoco>' + '<body>' * 10_000, 'more than 200 elements in one another'),
        ('<mujoco>' + '<a/>' * 100_001, 'more than 100000 elements'),
        ('<mujoco>\n<worldbody>', 'line 2: not valid XML: no element found'),
        ('<mujoco>\n<a></b></mujoco>', 'line 2: not valid XML: mismatched tag'),
        ('', 'line 1: not valid XML: no element found'),
        (b'\x7fELF\x00\x01\x02', 'line 1: not valid XML'),
        ('<mujoco a="é"/>'.encode('latin-1'), 'line 1: not valid XML: not well-formed'),
        ('<?xml version="1.0" encoding="klingon"?><mujoco/>', 'not valid XML'),
        ('<html/>', r'begins with <html>; .* <mujoco>, <robot> or <sdf>'),
        ('<robot xmlns:xacro="x"><xacro:property/></robot>', r'run `xacro robot.xml > robot'),
    ],
)  # fmt: skip
def test_what_is_no_description_is_refused_in_one_line(write, text, reason):
    with pytest.raises(InputError, match=reason) as caught:
        text_of(write(text))
    assert len(str(caught.value).splitlines()) == 1 and 'robot.xml' in str(caught.value)


def test_declared_encodings_are_read(write):
    text = '<?xml version="1.0" encoding="{}"?><robot name="é"/>'
    for encoding in ('iso-8859-1', 'utf-16', 'utf-8', 'cp1252'):
        path = write(text.format(encoding).encode(encoding))
        assert robot_file.parse_xml(text_of(path), 'text').get('name') == 'é'


def test_what_most_readers_forgive_is_forgiven(write):
    """Comments with dashes, and lines before the declaration."""
    text = '\n<!-- a -- b\n-->\n<?xml version="1.0"?>\n<robot name="r">\n<link/></robot>'
    root = robot_file.parse_xml(text_of(write(text, 'robot.urdf')), 'text')
    assert root.get('name') == 'r' and root.line == 5 and root.find('link').line == 6


def test_what_is_no_file_is_refused(write, tmp_path):
    os.mkfifo(tmp_path / 'pipe.xml')
    names = {
        '': 'is not a',
        'pipe.xml': 'is not a',
        'none.xml': 'does not',
        '\0': 'cannot|does not',
    }
    for name, reason in names.items():
        with pytest.raises(InputError, match=reason):
            text_of(tmp_path / name)
    with pytest.raises(InputError, match=r'run `xacro arm.urdf.xacro > robot'):
        text_of(write('<robot/>', 'arm.urdf.xacro'))
    with pytest.raises(InputError, match='more than 8388608 bytes'):
        text_of(write('<mujoco>' + ' ' * (8 << 20) + '</mujoco>'))


def test_loops_stand_in_the_text_of_a_urdf(write):
    path = write(f'<robot>{link("a")}{link("b")}{joint("j", "a", "b")}</robot>', 'robot.urdf')
    write("closed_loop: [['a', 'b']]\nname_mot: [j]\njoint_name: [j]\njoint_type: [SPHERICAL]",
          'robot.yaml')  # fmt: skip
    root = robot_file.parse_xml(text_of(path), 'text')
    assert root.find('closed_loop').attrib == {'first': 'a', 'second': 'b', 'type': '6d'}
    assert root.find('name_mot').attrib == {'joint': 'j'}
    assert root.find('joint_type').attrib == {'joint': 'j', 'type': 'SPHERICAL'}


@pytest.mark.parametrize(
    ('yaml', 'reason'),
    [
        ("closed_loop: [['a', 'b']]\ntype: []", None),
        ("closed_loop: [['a', 'b']]\ntype: [3d, 3d]", 'type has 2 values, not 1'),
        ("closed_loop: [['a']]", r"closed_loop holds pairs of frames, not \"\['a'\]\""),
        ('closed_loop: [[1, 2]]', "first must be a name, not '1'"),
        ('name_mot: j', "name_mot must be a list, not 'j'"),
        ('closed_loop: [', 'robot.yaml: '),
    ],
)
def test_wrong_loops_are_refused(write, yaml, reason):
    path = write('<robot/>', 'robot.urdf')
    write(yaml, 'robot.yaml')
    if reason is None:
        assert 'closed_loop' in text_of(path)
    else:
        with pytest.raises(InputError, match=reason):
            text_of(path)


def test_other_files_beside_a_urdf_do_not_matter(write):
    path = write('<robot/>', 'robot.urdf')
    write('controller: [1, 2]', 'robot.yaml')
    assert text_of(path) == '<?file robot.urdf?><robot/>\n'


def test_a_text_is_that_of_its_own_text(write):
    text = text_of(write(five_bar()))
    assert text_of(write(text)) == text
