"""Models, identification, compensation and discovery of piezo actuator hysteresis.

The rooms, and which way imports may point (``test/unit/test_architecture.py`` holds it)::

    records, waveforms, blocks <- models <- identification, compensation
        <- discovery <- reporting, cli, nodes

Only ``nodes`` imports rclpy.
"""

__version__ = '0.1.0'
