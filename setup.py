"""Package of the node and its core; `ament_python` under colcon, plain pip elsewhere."""

import re
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

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

setup(
    name=NAME,
    version=VERSION,
    description='Where two vehicles stand to each other, from nothing but their LiDAR clouds',
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
        'dev': ['ruff', 'mypy', 'types-PyYAML'],
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
    zip_safe=False,
)
