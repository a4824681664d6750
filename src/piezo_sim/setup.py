from pathlib import Path

from setuptools import find_packages, setup

package = 'piezo_sim'
config = Path('../../config')
nodes = ['simulator']

setup(
    name=package,
    version='0.1.0',
    packages=find_packages(),
    package_data={package: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package}']),
        (f'share/{package}', ['package.xml']),
        (
            f'share/{package}/config/presets',
            [str(f) for f in sorted(config.glob('presets/*.yaml'))],
        ),
    ],
    install_requires=['setuptools'],
    zip_safe=True,
    maintainer='The piezo_hysteresis maintainers',
    maintainer_email='maintainers@example.org',
    description='Simulated piezo actuators: the world that the suite is tried on',
    license='Apache-2.0',
    extras_require={'test': ['pytest']},
    # Not from this package: to import anything of it is slow already.
    entry_points={
        'console_scripts': [f'{node} = piezo_ros_common.starting:{node}' for node in nodes]
    },
)
