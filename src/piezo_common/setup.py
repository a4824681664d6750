from setuptools import find_packages, setup

package = 'piezo_common'

setup(
    name=package,
    version='0.1.0',
    packages=find_packages(),
    package_data={package: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package}']),
        (f'share/{package}', ['package.xml']),
    ],
    install_requires=['PyYAML>=6.0,<7'],
    python_requires='>=3.11',
    zip_safe=True,
    maintainer='The piezo_hysteresis maintainers',
    maintainer_email='maintainers@example.org',
    description='What nodes and core share without ROS',
    license='Apache-2.0',
    extras_require={'test': ['pytest']},
)
