import sys
from pathlib import Path

from setuptools import find_packages, setup

package = 'piezo_sim'

# The node is an executable for `ros2 run`, in a folder of this package. pip puts executables where
# those of all programs are: there it is `piezo node simulator`.
by_pip = not {'bdist_wheel', 'dist_info', 'editable_wheel'}.isdisjoint(sys.argv)
nodes = [] if by_pip else ['simulator']

setup(
    name=package,
    version='0.2.0',
    packages=find_packages(include=[f'{package}*']),
    package_data={package: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package}']),
        (f'share/{package}', ['package.xml']),
        *(
            (
                f'share/{package}/config/{kind}',
                [str(f) for f in sorted(Path('config', kind).glob('*.yaml'))],
            )
            for kind in ('presets', 'axes')
        ),
    ],
    install_requires=['numpy>=1.26,<3', 'piezo_hysteresis>=0.1,<1', 'PyYAML>=6,<7'],
    python_requires='>=3.11',
    zip_safe=True,
    maintainer='The piezo_hysteresis maintainers',
    maintainer_email='maintainers@example.org',
    description='Simulated piezo actuators: the world that the suite is tried on',
    license='Apache-2.0',
    extras_require={'test': ['pytest>=8']},
    # Not from this package: to import anything of it is slow already.
    entry_points={
        'console_scripts': [f'{node} = piezo_hysteresis.ros.starting:{node}' for node in nodes]
    },
)
