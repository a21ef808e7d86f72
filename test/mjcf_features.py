"""Ten small machines, each with what people write in MJCF beside bodies, joints and motors."""

from machine_files import mjcf

BOX = '<geom type="box" size="{0} 0.02 0.03" pos="{0} 0 0" mass="{1}"/>'


def chain(first, second, rest='', options='', between=''):
    """Two links in series, the joints of which have some attributes."""
    return mjcf(
        f"""
        <body name="near" euler="0 20 0"><joint name="a" axis="0 1 0" {first}/>
          {BOX.format(0.2, 1.2)}{between}
          <body name="far" pos="0.4 0 0" euler="10 30 0"><joint name="b" axis="0 1 0.2" {second}/>
            {BOX.format(0.15, 0.6)}<site name="tip" pos="0.3 0 0"/></body></body>""",
        rest,
        options,
    )


def motors(first='', second=''):
    return f'<actuator><motor joint="a" {first}/><motor joint="b" {second}/></actuator>'


ROTORS = chain(
    'armature="0.02"',
    '',
    """<actuator><motor joint="a" gear="30" armature="2e-5" damping="3e-4"/>
    <motor joint="a" gear="-8" armature="1e-4"/>
    <position joint="b" kp="90" gear="12" armature="4e-5" forcerange="-3 3"/></actuator>""",
)
GROWING = chain(
    'damping="0.4 0.7" stiffness="2 0 30" springref="15"',
    'damping="0.1 0 0.3" stiffness="0 6"',
    motors(),
)
TENDONS = chain(
    'frictionloss="0.3"',
    '',
    """<tendon><fixed name="belt" armature="0.3" damping="0.8" stiffness="40"
    springlength="0.1 0.2" limited="true" range="-1 1"><joint joint="a" coef="1.5"/>
    <joint joint="b" coef="-0.5"/></fixed></tendon>"""
    + motors(),
)
LIFTED = (
    chain(
        'actuatorfrcrange="-9 20" actuatorfrclimited="true"',
        '',
        motors('gear="10" ctrlrange="-1 3" ctrllimited="true"'),
    )
    .replace('name="near"', 'name="near" gravcomp="0.6"')
    .replace('name="far"', 'name="far" gravcomp="1"')
)
ONE_WAY = chain(
    '',
    'range="-40 70" limited="true"',
    motors(
        'gear="-2" ctrlrange="0 30" ctrllimited="true"',
        'gear="4" ctrlrange="-5 5" forcerange="-4 1" ctrllimited="true" forcelimited="true"',
    ),
)
LATE = chain(
    'damping="0.2"',
    '',
    """<actuator><general joint="a" dyntype="filter" dynprm="0.05" gainprm="60" ctrlrange="-1 1"
    ctrllimited="true"/><motor joint="b" gear="3"/></actuator>""",
)
SWITCHED_OFF = chain(
    'damping="0.5" stiffness="9" frictionloss="0.4" range="-1 1" limited="true"',
    'armature="0.01"',
    motors(),
    """<option><flag frictionloss="disable" damper="disable" spring="disable"
    limit="disable"/></option>""",
)


def leg(name, x, second):
    """An arm and a rod, which hangs on it by a ball."""
    return f"""
    <body name="arm{name}" pos="{x} 0 0" euler="0 30 {0 if x > 0 else 180}">
      <joint name="{name}" axis="0 1 0" damping="0.02"/>{BOX.format(0.1, 0.4)}
      <body name="rod{name}" pos="0.2 0 0" euler="0 45 0">{second}{BOX.format(0.15, 0.1)}
        <site name="end{name}" pos="0.3 0 0"/></body></body>"""


def standing(joint, more=''):
    """A five-bar in a vertical plane, whose second loop is closed by a body of its own."""
    return mjcf(
        leg('l', 0.1, joint.format('l')) + leg('r', -0.1, joint.format('r')) + more,
        '<equality><connect site1="endl" site2="endr"/></equality>'
        '<actuator><motor joint="l"/><motor joint="r"/></actuator>',
    )


WELDED = standing('<joint name="e{}" axis="0 1 0"/>').replace(
    '<connect ', '<weld torquescale="0" '
)
BALLS = mjcf(
    """<body name="arm"><joint name="a" axis="0 1 0" armature="0.01"/>
    <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.5"/>
    <body name="rod" pos="0.2 0 0"><joint name="joint" type="ball" armature="0.004"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0.2" size="0.01" mass="0.2"/>
      <site name="end" pos="0.3 0 0.2"/></body></body>
    <body name="cart" pos="0.5 0 0.2"><joint name="s" type="slide" axis="1 0 0"/>
      <geom type="box" size="0.03 0.03 0.03" mass="0.7"/><site name="pin"/><site name="tool"/>
    </body>""",
    """<equality><connect site1="end" site2="pin"/></equality>
    <actuator><motor joint="a"/></actuator>""",
)


def free_platform():
    """A plate that three sliders carry, held by nothing but their ends."""
    corners = [(0.3, 0.0), (-0.15, 0.26), (-0.15, -0.26)]
    legs = ''.join(
        f"""<body name="foot{i}" pos="{x} {y} 0"><joint name="u{i}" axis="{-y} {x} 0"/>
        <geom size="0.02" mass="0.1"/>
        <body name="ram{i}" pos="0 0 0.2"><joint name="s{i}" type="slide" axis="0 0 1"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.01" mass="0.3"/>
        <site name="top{i}" pos="0 0 0.2"/></body></body>"""
        for i, (x, y) in enumerate(corners)
    )
    sites = ''.join(f'<site name="p{i}" pos="{x} {y} 0"/>' for i, (x, y) in enumerate(corners))
    plate = f"""<body name="plate" pos="0 0 0.4"><freejoint/>
    <geom type="cylinder" size="0.3 0.01" mass="2"/>{sites}</body>"""
    ties = ''.join(f'<connect site1="top{i}" site2="p{i}"/>' for i in range(3))
    drives = ''.join(f'<motor joint="s{i}"/>' for i in range(3))
    return mjcf(legs + plate, f'<equality>{ties}</equality><actuator>{drives}</actuator>')


FEATURES = {
    'rotors': ROTORS, 'growing': GROWING, 'tendons': TENDONS, 'lifted': LIFTED,
    'one_way': ONE_WAY, 'late': LATE, 'switched_off': SWITCHED_OFF, 'welded': WELDED,
    'balls': BALLS, 'free_platform': free_platform(),
}  # fmt: skip
