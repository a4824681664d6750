from pathlib import Path

from setuptools import find_packages, setup

package = 'piezo_hysteresis'
config = Path('../../config')

# Every node and every verb of the command line is an executable of its own for `ros2 run`.
nodes = [
    'attenuation',
    'control_loop',
    'dashboard',
    'discovery',
    'excitation',
    'feedback',
    'feedforward',
    'gap_monitor',
    'identification',
    'player',
    'recorder',
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

setup(
    name=package,
    version='0.1.0',
    packages=find_packages(),
    package_data={package: ['py.typed', 'export/templates/*']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package}']),
        (f'share/{package}', ['package.xml']),
        (
            f'share/{package}/config/scenarios',
            [str(file) for file in sorted(config.glob('scenarios/*.yaml'))],
        ),
        (
            f'share/{package}/config/fuzzy',
            [str(file) for file in sorted(config.glob('fuzzy/*.yaml'))],
        ),
        (f'share/{package}/launch', [str(file) for file in sorted(Path('launch').glob('*.py'))]),
    ],
    install_requires=['setuptools'],
    zip_safe=True,
    maintainer='The piezo_hysteresis maintainers',
    maintainer_email='maintainers@example.org',
    description='Models, identifies and compensates piezo hysteresis; finds what the model misses',
    license='Apache-2.0',
    extras_require={'test': ['pytest']},
    entry_points={
        'console_scripts': [
            *(f'{node} = {package}.nodes.executables:{node}' for node in nodes),
            *(f'{verb} = {package}.cli.executables:{verb}_' for verb in verbs),
        ]
    },
)
