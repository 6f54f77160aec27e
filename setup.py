# SPDX-License-Identifier: Apache-2.0
"""Installs the Python package, its executables and its configuration (ament_python)."""

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = 'bev_preheat'


def configuration_files():
    """Every file below config/, with the share folder that it goes to."""
    folders = {}
    for path in sorted(Path('config').rglob('*')):
        if path.is_file():
            folders.setdefault(f'share/{PACKAGE}/{path.parent.as_posix()}', []).append(str(path))
    return list(folders.items())


setup(
    name=PACKAGE,
    version='0.2.0',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={PACKAGE: ['vehicle/schema.yaml', 'route/legs_schema.yaml',
                            'control/itinerary_schema.yaml',
                            'simulation/scenario_schema.yaml']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        *configuration_files(),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='bev_preheat maintainers',
    maintainer_email='maintainers@example.com',
    description='Battery preheating before fast charging, as a ROS 2 node.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            f'planner = {PACKAGE}.nodes.planner_node:main',
            f'nlp_checker = {PACKAGE}.nodes.nlp_checker_node:main',
            f'vehicle_simulator = {PACKAGE}.nodes.vehicle_simulator_node:main',
            f'preheat = {PACKAGE}.commands.main:main',
        ],
    },
)
