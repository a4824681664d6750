from pathlib import Path

from setuptools import find_packages, setup

package = 'piezo_papers'


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
    ],
    install_requires=[
        *(beside(name) for name in ('piezo_common', 'piezo_hysteresis', 'piezo_sim')),
        'matplotlib>=3.8,<4',
        'numpy>=1.26,<3',
        'scipy>=1.11,<2',
    ],
    python_requires='>=3.11',
    zip_safe=True,
    maintainer='The piezo_hysteresis maintainers',
    maintainer_email='maintainers@example.org',
    description='Figures and tables of five papers, made again on the simulated actuators',
    license='Apache-2.0',
    extras_require={'test': ['pytest']},
)
