# SPDX-License-Identifier: Apache-2.0
"""Installs the Python package, its executables and its configuration (ament_python)."""

import os
from pathlib import Path
import sys
from xml.etree import ElementTree

from setuptools import find_packages, setup
from setuptools.command.develop import develop
from setuptools.command.install_scripts import install_scripts

PACKAGE = 'bev_preheat'
STUDIES = 'bev_preheat_studies'
# A car needs no studies. With this variable at 1 they are not installed; preheat sweep, robustness and reproduce
# then end with one line. Build in a new folder, because setuptools does not remove files of an earlier build.
WITHOUT_STUDIES = os.environ.get('BEV_PREHEAT_WITHOUT_STUDIES', '') not in ('', '0')
ENTRY_POINTS = {
    'planner': f'{PACKAGE}.nodes.executables:planner',
    'nlp_checker': f'{PACKAGE}.nodes.executables:nlp_checker',
    'charger_adviser': f'{PACKAGE}.nodes.executables:charger_adviser',
    'vehicle_simulator': f'{PACKAGE}.nodes.executables:vehicle_simulator',
    'preheat': f'{PACKAGE}.commands.main:main',
}


def configuration_files():
    """Every file below config/ and launch/, with the share folder that it goes to."""
    folders = {}
    for path in sorted([*Path('config').rglob('*'), *Path('launch').rglob('*')]):
        if path.is_file():
            folders.setdefault(f'share/{PACKAGE}/{path.parent.as_posix()}', []).append(str(path))
    return list(folders.items())


def check_that_messages_are_built():
    """
    End a build by colcon that has no bev_preheat_msgs below it, and say what to type.

    colcon does not look for packages inside a package, so a plain `colcon build` finds bev_preheat
    alone, and the missing package would only show at run time.
    """
    if 'COLCON' not in os.environ or not {'install', 'develop'}.intersection(sys.argv):
        return
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    if not any(Path(prefix, 'share', f'{PACKAGE}_msgs', 'package.xml').is_file()
               for prefix in prefixes if prefix):
        here = Path(__file__).resolve().parent
        sys.exit(f'{PACKAGE}: {PACKAGE}_msgs is not built; it lies in {here}/msg_defs, where colcon '
                 f'does not look by itself. In a workspace type once: ln -s {here.name}/msg_defs '
                 f'{here.parent}/{PACKAGE}_msgs; ln -s {here.name}/core {here.parent}/{PACKAGE}_core, and '
                 f'colcon build finds all three; or build with: colcon build --base-paths {here} '
                 f'{here}/core {here}/msg_defs')


class DirectScripts:
    """
    Makes the executables of the entry points import and call them, as those that pip writes do.

    setuptools' own look the package up among all that are installed, at every start.
    """

    def write_script(self, script_name, contents, mode='t', *others):
        """Write an executable with the first line, Python's path, that setuptools has for it."""
        entry_point = ENTRY_POINTS.get(script_name)
        if entry_point is not None:
            module, function = entry_point.split(':')
            first_line = contents.splitlines()[0]
            contents = (f'{first_line}\nimport sys\n\nfrom {module} import {function}\n\n'
                        f"if __name__ == '__main__':\n    sys.exit({function}())\n")
        super().write_script(script_name, contents, mode, *others)


class InstallScripts(DirectScripts, install_scripts):
    """Of colcon build."""


class Develop(DirectScripts, develop):
    """Of colcon build --symlink-install."""


check_that_messages_are_built()
setup(
    name=PACKAGE,
    version=ElementTree.parse('package.xml').findtext('version'),
    packages=[*find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
              *([] if WITHOUT_STUDIES else find_packages('studies', include=[STUDIES, f'{STUDIES}.*']))],
    package_dir={} if WITHOUT_STUDIES else {STUDIES: f'studies/{STUDIES}'},
    package_data={PACKAGE: ['vehicle/schema.yaml', 'vehicle/heat_path_schema.yaml',
                            'route/legs_schema.yaml',
                            'charging/chargers_schema.yaml',
                            'control/itinerary_schema.yaml',
                            'simulation/scenario_schema.yaml', 'vehicle/chemistry.yaml',
                            'vehicle/vehicle_template.yaml',
                            'vehicle/road_load_template.yaml', 'ecu/c/*'],
                  STUDIES: ['footprint/*.[ch]']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        # colcon.pkg names these as hooks of the install space's setup files; bin/ comes into PATH.
        (f'share/{PACKAGE}/environment', ['resource/completion/preheat-argcomplete.bash',
                                          'resource/completion/preheat-argcomplete.zsh']),
        ('bin', ['resource/bin/preheat']),
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
        'console_scripts': [f'{name} = {function}' for name, function in ENTRY_POINTS.items()],
    },
    cmdclass={'install_scripts': InstallScripts, 'develop': Develop},
)
