"""Installation, for pip and for colcon. Name, version and people are those of package.xml."""

import contextlib
import subprocess
from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent
PACKAGE = ElementTree.parse(ROOT / 'package.xml').getroot()
NAME = PACKAGE.findtext('name')
MAINTAINER = PACKAGE.find('maintainer')
DOCS = ['mkdocs-material>=9.6,<10', 'mkdocstrings[python]>=0.30,<2']
EXPORT = ['pandas>=2.1', 'pyarrow>=14']
MUJOCO = [  # the engine alone, without its viewer, where there is such a package
    'mujoco-core>=4; python_version >= "3.11"',
    'mujoco>=3.2.7,<4; python_version < "3.11"',
]
STUDY = ['pyarrow>=14', 'tqdm>=4.66']
CLUSTER = ['dask>=2024.1', 'distributed>=2024.1']
TUNE = [*STUDY, 'optuna>=5,<6']
LIVE = ['aiohttp>=3.10,<4']
VIDEO = ['av>=12,<19']
FMU = ['fmpy>=0.3.20,<0.4']
FOXGLOVE = ['foxglove-sdk>=0.30,<0.31']
TOP = ['rich>=14.2,<16', 'textual>=6,<9']
ALL = [*EXPORT, *MUJOCO, *TUNE, *LIVE, *VIDEO, *FOXGLOVE, *FMU, *TOP]
SOURCE = ['setuptools>=70.1']  # installs changed sources without the network


class BuildWithRevision(build_py):
    """Notes what git calls this tree: `--version` and bags of what is installed tell it."""

    def run(self):
        """Build, and note it."""
        super().run()
        if not (ROOT / '.git').exists() or getattr(self, 'editable_mode', False):
            return
        words = 'git', 'describe', '--always', '--dirty'
        with contextlib.suppress(OSError, subprocess.SubprocessError):
            revision = subprocess.run(words, cwd=ROOT, capture_output=True, check=True).stdout
            Path(self.build_lib, NAME, 'REVISION').write_bytes(revision)


setup(
    name=NAME,
    version=PACKAGE.findtext('version'),
    description=PACKAGE.findtext('description'),
    maintainer=MAINTAINER.text,
    maintainer_email=MAINTAINER.get('email'),
    license=PACKAGE.findtext('license'),
    keywords=['ROS', 'parallel robot', 'sliding mode control', 'synchronisation'],
    classifiers=[
        'Intended Audience :: Science/Research',
        'Operating System :: POSIX :: Linux',
        'Programming Language :: Python :: 3',
        'Topic :: Scientific/Engineering',
    ],
    packages=[
        'parallel_robot',
        'parallel_robot.analysis',
        'parallel_robot.analysis.replay',
        'parallel_robot.analysis.report',
        'parallel_robot.bags',
        'parallel_robot.bags.files',
        'parallel_robot.bags.messages',
        'parallel_robot.bags.run',
        'parallel_robot.bags.writing',
        'parallel_robot.cli',
        'parallel_robot.cli.commands',
        'parallel_robot.fmu',
        'parallel_robot.live',
        'parallel_robot.python',
        'parallel_robot.studies',
        'parallel_robot.studies.benchmark',
        'parallel_robot.studies.calibration',
        'parallel_robot.studies.identification',
        'parallel_robot.studies.sweep',
        'parallel_robot.studies.tuning',
        'parallel_robot.watch',
        'parallel_robot_control',
        'parallel_robot_control.estimation',
        'parallel_robot_control.foreign',
        'parallel_robot_control.laws',
        'parallel_robot_control.safety',
        'parallel_robot_model',
        'parallel_robot_model.common',
        'parallel_robot_model.compiler',
        'parallel_robot_model.compiler.elementary',
        'parallel_robot_model.configuration',
        'parallel_robot_model.mechanisms',
        'parallel_robot_model.mechanisms.description',
        'parallel_robot_model.messages',
        'parallel_robot_model.nodes',
        'parallel_robot_model.processes',
        'parallel_robot_model.robots',
        'parallel_robot_model.robots.described',
        'parallel_robot_model.robots.planar_3rrr',
        'parallel_robot_sim',
        'trajectory_gen',
    ],
    package_data={
        'parallel_robot.bags.messages': ['*.json'],
        'parallel_robot.analysis.report': ['templates/*'],
        'parallel_robot.fmu': ['c/*', 'ros2_control/*'],
        'parallel_robot_control.foreign': ['*.h'],
        'parallel_robot.live': ['static/*.*', 'static/uplot/*'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/config', glob('config/*.yaml')),
        (f'share/{NAME}/config/benchmarks', glob('config/benchmarks/*.yaml')),
        (f'share/{NAME}/config/laws', glob('config/laws/*.yaml')),
        (f'share/{NAME}/config/hardware', glob('config/hardware/*.*')),
        (f'share/{NAME}/config/machines', glob('config/machines/*.*')),
        (f'share/{NAME}/config/middleware', glob('config/middleware/*.xml')),
        (f'share/{NAME}/config/robots', glob('config/robots/*.yaml')),
        (f'share/{NAME}/config/scenarios', glob('config/scenarios/*.yaml')),
        (f'share/{NAME}/config/studies', glob('config/studies/*.yaml')),
        (f'share/{NAME}/config/views', glob('config/views/*.*')),
        (f'share/{NAME}/launch', glob('launch/*.launch.py')),
        # Where `ros2 run` looks; pip puts console scripts only in bin/.
        (f'lib/{NAME}', glob('scripts/*')),
    ],
    entry_points={'console_scripts': [f'{NAME} = parallel_robot.__main__:main']},
    cmdclass={'build_py': BuildWithRevision},
    zip_safe=True,
    python_requires='>=3.10,<3.14',
    install_requires=[
        'argcomplete>=3.1',
        'jinja2>=3.1',
        'lz4>=4.3',
        'matplotlib>=3.8',
        'mcap>=1.1',
        # Of Numba private parts are used: see parallel_robot_model/compiler/numba_parts.py.
        'numba>=0.59,<0.69',
        'numpy>=1.26',
        'pillow>=10',
        'plotly>=5.24',
        'pyyaml>=6.0.1',
        'rosbags>=0.10.9',
        'scipy>=1.11',
        'threadpoolctl>=3.1',
        'zstandard>=0.22',
    ],
    extras_require={
        # The middleware where no ROS is installed; rclpy does not import without [fastrtps].
        'ros': [
            'ros-jazzy-rclpy[fastrtps]==7.1.6',
            'ros-jazzy-common-interfaces==5.3.6',
        ],
        # Tables for others: .parquet, and pandas' frames.
        'export': EXPORT,
        # The screen of `parallel_robot top`; Ubuntu's package is too old.
        'top': TOP,
        # The page of `parallel_robot live`.
        'live': LIVE,
        # `parallel_robot live --foxglove`.
        'foxglove': FOXGLOVE,
        # `parallel_robot sweep`, and `sweep --scheduler`.
        'study': STUDY,
        'cluster': CLUSTER,
        # `parallel_robot tune`.
        'tune': TUNE,
        # `parallel_robot verify`.
        'mujoco': MUJOCO,
        # `parallel_robot video --out x.mp4`; a GIF needs nothing more.
        'video': VIDEO,
        # An FMU as a law.
        'fmu': FMU,
        # All of these.
        'all': ALL,
        # `make demo`, `make setup`.
        'source': SOURCE,
        # `make site`.
        'docs': DOCS,
        # Exact where another version may judge the same code differently.
        'test': [
            *ALL,
            *CLUSTER,
            *DOCS,
            *SOURCE,
            'fmpy==0.3.32',
            'hypothesis>=6.100',
            'import-linter>=2.16,<3',
            'ipykernel>=6.29',
            'markdown-it-py>=3',
            'mcap-ros2-support>=0.5',
            'ros-jazzy-domain-coordinator==0.12.0',
            'mypy==2.4.1',
            'nbclient>=0.10',
            'nbformat>=5.10',
            'pytest>=9.0,<9.2',  # 9.2 hides from pytest-xdist 3.8 which tests are a group
            'pytest-xdist>=3.6',
            'ruff==0.17.5',
            'selenium>=4.20',
            'types-PyYAML>=6.0.12',
        ],
    },
)
