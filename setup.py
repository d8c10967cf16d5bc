from pathlib import Path

from setuptools import find_packages, setup

package_name = 'wrist_ft_comp'


def files_in(folder):
    return sorted(str(path) for path in Path(folder).iterdir() if path.is_file())


setup(
    name=package_name,
    version='0.3.0',
    packages=find_packages(include=[package_name, f'{package_name}.*']),
    package_data={
        package_name: ['py.typed'],
        f'{package_name}.stored': ['*.schema.json'],
        f'{package_name}.report': ['templates/*'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml', 'README.md', 'CHANGELOG.rst', 'LICENSE']),
        (f'share/{package_name}/docs', files_in('docs')),
        (f'share/{package_name}/config', files_in('config')),
        (f'share/{package_name}/launch', files_in('launch')),
        (f'share/{package_name}/data/keller_pa10', files_in('data/keller_pa10')),
    ],
    python_requires='>=3.10',
    # Lower bounds are Ubuntu 24.04's versions; requirements/lock.txt holds what is tested.
    install_requires=[
        'setuptools',
        'numpy>=1.26,<3',
        'scipy>=1.11,<2',
        'pandas>=2.1,<3',
        'PyYAML>=6.0,<7',
        'matplotlib>=3.6,<4',
        'jinja2>=3.1,<4',
        'rich>=13.7,<16',
    ],
    extras_require={
        'ros': ['ros-jazzy-rclpy[fastrtps]>=7.1,<8', 'ros-jazzy-common-interfaces>=5.3,<6'],
        'bags': ['rosbags>=0.11,<0.12'],  # a system ROS reads them by rosbag2_py
        'test': [
            'pytest>=7.4,<10',
            'pytest-xdist>=3.8,<4',  # newer than Ubuntu's: knows --no-loadscope-reorder
            'hypothesis>=6,<7',
            'jsonschema>=4.10,<5',
            'distributed>=2024.1',  # docs/fleet.md
            'openpyxl>=3.1,<4',  # tables that people keep in workbooks
            'rosbags>=0.11,<0.12',
            'scikit-learn>=1.4,<2',
        ],
        'lint': [
            'ruff>=0.17,<0.18',
            'flake8>=7.0,<8',
            'flake8-blind-except',
            'flake8-builtins',
            'flake8-class-newline',
            'flake8-comprehensions',
            'flake8-deprecated',
            'flake8-docstrings',
            'flake8-import-order',
            'flake8-quotes',
            'mypy>=2.4,<3',
            'types-PyYAML',
            'types-jsonschema',
        ],
    },
    zip_safe=True,
    maintainer='wrist_ft_comp developers',
    maintainer_email='maintainers@wrist-ft-comp.invalid',
    description='Removes the temperature drift of a wrist force/torque sensor',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'compensator = wrist_ft_comp.__main__:compensator',
            'simulated_sensor = wrist_ft_comp.__main__:simulated_sensor',
            'wrist_ft_comp = wrist_ft_comp.__main__:main',
        ],
    },
)
