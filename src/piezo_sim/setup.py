from pathlib import Path

from setuptools import find_packages, setup

package = 'piezo_sim'
config = Path('../../config')
nodes = ['simulator']


def beside(name):
    """Return the requirement of a package of this workspace: its folder, where that is there."""
    folder = Path(__file__).resolve().parents[1] / name
    return f'{name} @ {folder.as_uri()}' if (folder / 'setup.py').is_file() else name


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
    install_requires=[
        *(beside(name) for name in ('piezo_common', 'piezo_kernels', 'piezo_hysteresis')),
        'numpy>=1.26,<3',
        'PyYAML>=6,<7',
    ],
    python_requires='>=3.11',
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
