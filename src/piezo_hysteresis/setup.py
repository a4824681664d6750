import sys
from pathlib import Path
from runpy import run_path

from setuptools import find_packages, setup

package = 'piezo_hysteresis'

# Every node and every verb of the command line is an executable of its own for `ros2 run`, in a
# folder of this package. pip puts them where those of all programs are: there it is `piezo` alone.
by_pip = not {'bdist_wheel', 'dist_info', 'editable_wheel'}.isdisjoint(sys.argv)
nodes = [
    name
    for name, module in run_path(f'{package}/common/registry.py')['NODES'].items()
    if module.startswith(f'{package}.')
]
verbs = [
    'batch',
    'compensate',
    'demo',
    'discover',
    'export',
    'identify',
    'import',
    'info',
    'investigate',
    'linear',
    'loop',
    'play',
    'record',
    'validate',
]


def share(folder, pattern):
    """Return files of a folder of this package with where they are installed."""
    return f'share/{package}/{folder}', [str(file) for file in sorted(Path(folder).glob(pattern))]


setup(
    name=package,
    version='0.2.0',
    packages=find_packages(include=[f'{package}*']),
    package_data={package: ['py.typed', 'export/templates/*', 'ros/*.xml']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package}']),
        (f'share/{package}', ['package.xml']),
        share('config/scenarios', '*.yaml'),
        share('config/fuzzy', '*.yaml'),
        share('launch', '*.py'),
    ],
    install_requires=[
        'bokeh>=3.3,<4',
        'Jinja2>=3,<4',
        'llvmlite>=0.42',
        'matplotlib>=3.8,<4',
        'numba>=0.59,<1',
        'numpy>=1.26,<3',
        'PyYAML>=6,<7',
        'rich>=13,<16',
        'rosbags>=0.10,<0.12',
        'scipy>=1.11,<2',
        'shtab>=1.6,<2',
    ],
    python_requires='>=3.11',
    zip_safe=True,
    maintainer='The piezo_hysteresis maintainers',
    maintainer_email='maintainers@example.org',
    description='Models, identifies and compensates piezo hysteresis; finds what the model misses',
    license='Apache-2.0',
    extras_require={
        'arrow': ['pyarrow>=14'],  # Parquet and Feather; large CSV files several times faster
        'dashboard': ['tornado>=6.3,<7'],
        'dask': ['distributed>=2024.1'],
        'formats': ['h5py>=3,<4', 'npTDMS>=1.7,<2', 'openpyxl>=3.1,<4', 'pyarrow>=14'],
        'instruments': ['asammdf>=8,<9', 'igor2>=0.5,<1', 'pyuff>=2.4,<3'],  # .mf4, .ibw, .uff
        'pandas': ['pandas>=2,<4'],  # data frames of results
        'serial': ['pyserial>=3.5,<4'],  # controllers on a serial port
        'test': ['hypothesis>=6', 'pytest>=8', 'pytest-xdist>=3'],
    },
    entry_points={
        'console_scripts': [
            f'piezo = {package}.__main__:run',
            *(f'{node} = {package}.ros.starting:{node}' for node in nodes if not by_pip),
            *(f'{verb} = {package}.cli.executables:{verb}_' for verb in verbs if not by_pip),
        ]
    },
)
