"""Descriptions of small machines."""

INERTIAL = '<inertial pos="{0} 0 0" mass="{1}" diaginertia="0.01 0.02 0.02"/>'


def mjcf(world, rest='', options=''):
    return f'<mujoco>{options}<worldbody>{world}</worldbody>{rest}</mujoco>'


def five_bar(closure='<connect site1="a" site2="b"/>', actuators=('left', 'right')):
    """Two legs of two links in the x-y plane, 0.4 m apart, which meet at the top."""

    def leg(name, x, tip):
        return f"""
        <body pos="{x} 0 0" euler="0 0 {100 if x < 0 else 80}">
          <joint name="{name}"/>{INERTIAL.format(0.1, 1)}
          <body pos="0.3 0 0" euler="0 0 {-60 if x < 0 else 60}">
            <joint name="{name}_elbow"/>{INERTIAL.format(0.15, 0.5)}
            <site name="{tip}" pos="0.3 0 0"/>
          </body>
        </body>"""

    motors = ''.join(f'<motor name="m_{joint}" joint="{joint}"/>' for joint in actuators)
    return mjcf(
        leg('left', -0.2, 'a') + leg('right', 0.2, 'b'),
        f'<equality>{closure}</equality><actuator>{motors}</actuator>',
    )


ARM = mjcf(
    """
    <body name="base" pos="0 0 0.1">
      <inertial pos="0 0 0" mass="9" diaginertia="1 1 1"/>
      <body name="upper" pos="0 0 0.2" euler="10 20 30">
        <joint name="pan" axis="0 0 1" damping="0.3" frictionloss="0.2" range="-90 90"/>
        <joint name="tilt" axis="0 1 0" pos="0.05 0 0.02" ref="20" armature="0.1"/>
        <inertial pos="0.1 0.02 0.3" mass="3" fullinertia="0.05 0.06 0.03 0.01 0.002 -0.004"/>
        <body name="mount" pos="0.3 0.1 0" quat="0.9 0.1 0.2 0.3">
          <geom type="box" size="0.05 0.1 0.02" pos="0 0.1 0" euler="5 6 7"/>
          <body name="rod" pos="0.1 0 0.4">
            <joint name="slide" type="slide" axis="1 1 0" ref="0.1" range="-0.2 0.3"/>
            <inertial pos="0 0.1 0.1" mass="1" diaginertia="0.01 0.02 0.015"/>
            <body name="fork" pos="0 0.1 0.1">
              <joint name="ball" type="ball" pos="0 0.02 0"/>
              <inertial pos="0.02 0.1 0" mass="0.5" diaginertia="0.002 0.003 0.004"/>
              <site name="tool" pos="0.1 0.2 0.3" euler="20 0 0"/>
            </body>
          </body>
        </body>
      </body>
    </body>""",
    """
    <actuator>
      <motor joint="pan" gear="20" ctrlrange="-2 2"/>
      <position joint="tilt" kp="100" forcerange="-30 40"/>
      <motor joint="slide"/>
    </actuator>
    <keyframe><key name="home" qpos="0.3 0.5 0.2 0.9 0.1 0.3 0.2"/></keyframe>""",
    '<option gravity="1 2 -9"/>',
)

URDF = """
<robot name="arm">
  <link name="base"/>
  <link name="first">
    <inertial>
      <origin xyz="0.1 0.02 0.3" rpy="0.1 0.2 0.3"/><mass value="3"/>
      <inertia ixx="0.05" iyy="0.06" izz="0.03" ixy="0.01" ixz="0.002" iyz="-0.004"/>
    </inertial>
    <visual><geometry><mesh filename="package://nowhere/first.stl"/></geometry></visual>
  </link>
  <link name="flange">
    <inertial>
      <origin xyz="0 0.1 0"/><mass value="1.5"/>
      <inertia ixx="0.01" iyy="0.02" izz="0.015" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <link name="second">
    <inertial>
      <origin xyz="0.2 0 0.1"/><mass value="2"/>
      <inertia ixx="0.02" iyy="0.03" izz="0.03" ixy="0.001" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="shoulder" type="revolute">
    <origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/><parent link="base"/><child link="first"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="50" velocity="3"/>
    <dynamics damping="0.4" friction="0.1"/>
  </joint>
  <joint name="bolt" type="fixed">
    <origin xyz="0.3 0 0" rpy="0 0.3 0"/><parent link="first"/><child link="flange"/>
  </joint>
  <joint name="stroke" type="prismatic">
    <origin xyz="0 0 0.5" rpy="1 0 0"/><parent link="flange"/><child link="second"/>
    <axis xyz="1 0 1"/><limit lower="0" upper="0.4" effort="0" velocity="0"/>
  </joint>{0}
</robot>
"""


def urdf(more=''):
    return URDF.replace('{0}', more)


def link(name, mass=1.0):
    return f"""<link name="{name}"><inertial><mass value="{mass}"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


def joint(name, parent, child, kind='revolute', xyz='0 0 0', axis='0 0 1', more=''):
    return f"""<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
    <origin xyz="{xyz}"/><axis xyz="{axis}"/>{more}</joint>"""
