"""Package of the node and its core; `ament_python` under colcon, plain pip elsewhere.

A wheel holds the kernels compiled for every instruction set of its platform; a checkout does not.
"""

import os
import re
import shutil
import subprocess
import sys
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

try:
    from setuptools.command.bdist_wheel import bdist_wheel
except ImportError:  # before 70.1: Ubuntu's, which colcon needs for no wheel
    bdist_wheel = object

NAME = 'gcl_ros'
VERSION = re.search("^__version__ = '(.+?)'", Path('gcl_core/__init__.py').read_text(), re.M)[1]
ROS_PACKAGES = [
    'rclpy',
    'rmw-fastrtps-cpp',
    'std-msgs',
    'sensor-msgs',
    'geometry-msgs',
    'nav-msgs',
    'rosgraph-msgs',
    'rcl-interfaces',
    'lifecycle-msgs',
    'diagnostic-msgs',
    'visualization-msgs',
    'std-srvs',
]


class Wheel(bdist_wheel):
    """A wheel for one platform and any Python 3: the kernels in it are loaded by ctypes.

    Where there is no compiler, or no Linux, it is one for any platform without compiled kernels.
    """

    def run(self):
        """Compile the kernels beside the modules that were built, then pack all of it."""
        self.run_command('build')
        if self.kernels(Path(self.get_finalized_command('build').build_lib)):
            self.root_is_pure = False
            self.distribution.has_ext_modules = lambda: True  # it goes where compiled code goes
        super().run()

    def kernels(self, package):
        """Compile them into a package; how many were made."""
        sys.path.insert(0, str(Path(__file__).parent.absolute()))
        from gcl_core.ops.native import build

        folder = package / 'gcl_core/ops/native' / build.SHIPPED.name
        shutil.rmtree(folder, ignore_errors=True)  # of another build
        system, _, machine = self.plat_name.replace('-', '_').partition('_')
        compiler = shutil.which(os.environ.get('CXX', 'c++'))
        if compiler is None or system != 'linux':
            return 0
        target = subprocess.run([compiler, '-dumpmachine'], capture_output=True, text=True).stdout
        if target.partition('-')[0] != machine:
            sys.exit(f'{compiler} compiles for {target.strip()}, not for {machine}: set CXX')
        return len(build.ship(compiler, machine, folder))

    def get_tag(self):
        """Whatever Python builds it, any runs it."""
        return 'py3', 'none', super().get_tag()[2]


setup(
    name=NAME,
    version=VERSION,
    description='Where two vehicles stand to each other, from nothing but their LiDAR clouds',
    long_description=Path('README.md').read_text(),
    long_description_content_type='text/markdown',
    license='Apache-2.0',
    maintainer='GCL-ROS developers',
    maintainer_email='gcl-ros@users.noreply.github.com',
    python_requires='>=3.10',
    packages=find_packages(include=['gcl_core*', 'gcl_ros*']),
    package_data={
        'gcl_core': ['py.typed'],
        'gcl_core.compact': ['priors.xz'],
        'gcl_core.models': ['weights/*'],
        'gcl_core.ops.native': ['*.cpp', '*.h'],
        'gcl_core.evaluation': ['published.yaml', 'page/*.js', 'page/*.css'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/config', glob('config/*')),
        (f'share/{NAME}/launch', glob('launch/*.launch.py')),
        (f'share/{NAME}/rviz', glob('rviz/*')),
    ],
    install_requires=[
        'torch>=2.4',
        'numpy>=1.26',
        'scipy>=1.10',
        'open3d-cpu>=0.19; platform_system == "Linux" and platform_machine == "x86_64"',
        'open3d>=0.19; platform_system != "Linux" or platform_machine != "x86_64"',
        'small_gicp>=1.0',
        'safetensors>=0.4.3',
        'pyyaml>=6',
        'jaxtyping>=0.2.28',
        'matplotlib>=3.7',
        'tqdm>=4.60',
        'rosbags>=0.11',
    ],
    extras_require={
        # rclpy from PyPI, for machines without a ROS 2 installation: one of the two
        'ros': [f'ros-kilted-{package}' for package in ROS_PACKAGES],
        'ros-jazzy': [f'ros-jazzy-{package}' for package in ROS_PACKAGES],
        'test': [
            'pytest>=7',
            'hypothesis>=6',
            'argcomplete>=2',
            'tensorboard',
            'setuptools<80',  # the last that colcon's ament_python build works with
            'colcon-core',
            'colcon-ros',
            'colcon-python-setup-py',
            'colcon-recursive-crawl',
            'colcon-bash',
            'colcon-package-selection',
            'catkin-pkg',
        ],
        'train': ['tensorboard'],
        'kiss': ['kiss-matcher>=1.0'],  # one more estimator and peer, for comparison
        'completion': ['argcomplete>=2'],  # eval "$(register-python-argcomplete gcl)"
        'rerun': ['rerun-sdk>=0.20'],  # recordings to look around in: gcl register --rerun
        'dev': [
            'ruff',
            'mypy',
            'types-PyYAML',
            'pre-commit',
            'properdocs',  # make site
            'properdocs-theme-mkdocs',
        ],
    },
    entry_points={
        'console_scripts': [
            'registrar = gcl_ros.registrar:main',
            'sender = gcl_ros.sender:main',
            'describer = gcl_ros.describer:main',
            'replay = gcl_ros.replay:main',
            'evaluate_bag = gcl_ros.evaluate_bag:main',
            'gcl = gcl_core.cli.main:main',
        ]
    },
    cmdclass={'bdist_wheel': Wheel} if bdist_wheel is not object else {},
    zip_safe=False,
)
