# SPDX-License-Identifier: Apache-2.0
"""Installs the Python package, its executables and its configuration (ament_python)."""

from concurrent.futures import ThreadPoolExecutor
import os
from pathlib import Path
import subprocess
import sys
from xml.etree import ElementTree

from setuptools import Extension, find_packages, setup
from setuptools.command.build_ext import build_ext

HERE = Path(__file__).resolve().parent
PACKAGE = 'bev_preheat'
STUDIES = 'bev_preheat_studies'
# A car needs no studies. With this variable at 1 they are not installed; preheat sweep, robustness and reproduce
# then end with one line. Build in a new folder, because setuptools does not remove files of an earlier build.
WITHOUT_STUDIES = os.environ.get('BEV_PREHEAT_WITHOUT_STUDIES', '') not in ('', '0')
ENTRY_POINTS = {
    'planner': f'{PACKAGE}.nodes:planner',
    'nlp_checker': f'{PACKAGE}.nodes:nlp_checker',
    'charger_adviser': f'{PACKAGE}.nodes:charger_adviser',
    'bus_gateway': f'{PACKAGE}.nodes:bus_gateway',
    'route_publisher': f'{PACKAGE}.nodes:route_publisher',
    'heater_controller': f'{PACKAGE}.nodes:heater_controller',
    'vehicle_simulator': f'{PACKAGE}.nodes:vehicle_simulator',
    'dashboard': f'{PACKAGE}.nodes:dashboard',
    'preheat': f'{PACKAGE}.commands.main:main',
}


# colcon installs the files of config/ in the share folder and builds the C core as a package of its own; without
# colcon (pip, build) both are parts of the Python package.
WITH_COLCON = 'COLCON' in os.environ
CONFIGURATION, CORE = f'{PACKAGE}.config', f'{PACKAGE}.vehicle.libbev_preheat_core'
# The oldest supported versions are those of scripts/requirements-oldest.txt.
REQUIREMENTS = ['argcomplete>=3.1.4', 'jsonschema>=4.10.3', 'numpy>=1.26.4', 'pyyaml>=6.0.1', 'rich>=13.7.1']
EXTRAS = {
    'bus': ['cantools>=39', 'kuksa-client>=0.4.3', 'pyserial>=3.5', 'python-can>=4.0'],
    'nlp': ['casadi>=3.6'],
    'plot': ['matplotlib>=3.6.3'],
    'dashboard': ['mcap>=1.0', 'tornado>=6.4'],
    'identify': ['casadi>=3.6', 'jinja2>=3.1.2', 'matplotlib>=3.6.3', 'scipy>=1.11.4'],
    'logs': ['asammdf>=7.3', 'cantools>=39', 'mcap>=1.0', 'python-can>=4.0', 'rosbags>=0.10'],
    'studies': ['casadi>=3.6', 'matplotlib>=3.6.3', 'psutil>=5.9.8', 'scipy>=1.11.4'],
    'tables': ['pandas'],
    'test': ['pytest'],
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
    if not WITH_COLCON or not {'install', 'develop'}.intersection(sys.argv):
        return
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    if not any(Path(prefix, 'share', f'{PACKAGE}_msgs', 'package.xml').is_file()
               for prefix in prefixes if prefix):
        sys.exit(f'{PACKAGE}: {PACKAGE}_msgs is not built; it lies in {HERE}/msg_defs, where colcon does not look '
                 f'by itself. Build with: colcon build --base-paths {HERE.parent} {HERE}/core {HERE}/msg_defs')


class BuildCore(build_ext):
    """
    Builds the C core as a library of the package; its equations are generated from the Python ones first.

    Without a compiler the package is installed all the same: every caller of the core has a Python fallback.
    """

    def build_extension(self, extension):
        """Generate the headers and compile."""
        generated = Path(self.build_temp, 'generated')
        headers = generated / 'bev_preheat_core_generated'
        subprocess.run([sys.executable, '-m', f'{PACKAGE}.code_generation.c_source', str(headers)], check=True,
                       env={**os.environ, 'PYTHONPATH': os.pathsep.join([str(HERE), *sys.path])})
        extension.include_dirs.append(str(generated))
        # One file after the other would take most of the time of pip install.
        sources, extension.sources = extension.sources, []
        extension.depends = [*extension.depends, *sources]
        with ThreadPoolExecutor(os.cpu_count()) as threads:
            compiled = threads.map(lambda source: self.compiler.compile(
                [source], output_dir=self.build_temp, include_dirs=extension.include_dirs,
                extra_postargs=extension.extra_compile_args), sources)
            extension.extra_objects = [each for objects in compiled for each in objects]
        super().build_extension(extension)

    def get_ext_filename(self, name):
        """Return the library's file name, without the suffix of a Python version: ctypes loads it."""
        is_core = name.rpartition('.')[2] == CORE.rpartition('.')[2]
        return os.path.join(*name.split('.')) + '.so' if is_core else super().get_ext_filename(name)

    def get_export_symbols(self, extension):
        """Export the C functions as they are; there is no PyInit function."""
        return extension.export_symbols


def core_library():
    """Return the Extension that is the C core, with the compiler options of core/CMakeLists.txt."""
    return Extension(
        CORE, sources=sorted(map(str, Path('core', 'src').glob('*.c'))),
        include_dirs=['core/include', 'core/src'], libraries=['m'], optional=True,
        extra_compile_args=['-std=c99', '-O3', '-g0', '-ffp-contract=off', '-fno-math-errno',
                            '-fno-trapping-math'])


check_that_messages_are_built()
setup(
    name=PACKAGE,
    version=ElementTree.parse('package.xml').findtext('version'),
    packages=[*find_packages(include=[PACKAGE, f'{PACKAGE}.*']), *([] if WITH_COLCON else [CONFIGURATION]),
              *([] if WITHOUT_STUDIES else find_packages('studies', include=[STUDIES, f'{STUDIES}.*']))],
    package_dir={**({} if WITHOUT_STUDIES else {STUDIES: f'studies/{STUDIES}'}),
                 **({} if WITH_COLCON else {CONFIGURATION: 'config'})},
    package_data={PACKAGE: ['vehicle/schema.yaml', 'vehicle/heat_path_schema.yaml',
                            'route/legs_schema.yaml', 'logs/signal_map_schema.yaml',
                            'charging/chargers_schema.yaml', 'identification/report.html',
                            'control/departures_schema.yaml', 'control/grid_prices_schema.yaml',
                            'control/itinerary_schema.yaml',
                            'simulation/scenario_schema.yaml', 'vehicle/chemistry.yaml',
                            'monitoring/assets/*', 'code_generation/c/*'],
                  STUDIES: ['published.yaml', 'published_schema.yaml'],
                  CONFIGURATION: ['*.yaml', '*/*', '*/*/*']},
    ext_modules=[] if WITH_COLCON else [core_library()],
    data_files=[] if not WITH_COLCON else [
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        # colcon.pkg names these as hooks of the install space's setup files; bin/ comes into PATH.
        (f'share/{PACKAGE}/environment', ['resource/completion/preheat-argcomplete.bash',
                                          'resource/completion/preheat-argcomplete.zsh']),
        ('bin', ['resource/bin/preheat']),
        *configuration_files(),
    ],
    python_requires='>=3.11',
    install_requires=['setuptools'] if WITH_COLCON else REQUIREMENTS,
    extras_require=EXTRAS,
    zip_safe=False,
    maintainer='bev_preheat maintainers',
    maintainer_email='maintainers@example.com',
    description='Battery preheating before fast charging, as a ROS 2 node.',
    license='Apache-2.0',
    entry_points={
        # The nodes run with ROS, so with colcon.
        'console_scripts': [f'{name} = {function}' for name, function in ENTRY_POINTS.items()
                            if WITH_COLCON or name == 'preheat'],
    },
    cmdclass={'build_ext': BuildCore},
)
