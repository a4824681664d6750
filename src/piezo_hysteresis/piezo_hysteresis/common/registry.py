"""Every node of the suite, by its name, and the module that runs it.

Entry points, the verbs `node` and `loop`, launch files and pages use this table. The sheet of each
node is in `parameters/sheets.py`. No imports: setup.py reads this file.
"""

NODES = {
    'simulator': 'piezo_sim.nodes.simulator',
    'excitation': 'piezo_hysteresis.nodes.excitation.excitation',
    'feedforward': 'piezo_hysteresis.nodes.links.feedforward_node',
    'attenuation': 'piezo_hysteresis.nodes.links.attenuation_node',
    'feedback': 'piezo_hysteresis.nodes.links.feedback_node',
    'control_loop': 'piezo_hysteresis.nodes.links.control_loop',
    'identification': 'piezo_hysteresis.nodes.identification',
    'gap_monitor': 'piezo_hysteresis.nodes.gap',
    'recorder': 'piezo_hysteresis.nodes.recording.recorder_node',
    'player': 'piezo_hysteresis.nodes.recording.player_node',
    'gcs_driver': 'piezo_hysteresis.nodes.gcs_driver',
    'dashboard': 'piezo_hysteresis.nodes.dashboard.dashboard_node',
}
# Where the sheets of the nodes of a package are.
SHEETS = {
    'piezo_hysteresis': 'piezo_hysteresis.parameters.sheets',
    'piezo_sim': 'piezo_sim.nodes.simulator_tables',
}


def package_of(node: str) -> str:
    """Return the package of a node, as ``ros2 run`` wants it."""
    return NODES[node].partition('.')[0]


def inside(settings: dict[str, dict[str, object]]) -> dict[str, object]:
    """Return the parameters of a process that holds several nodes, from those of each node."""
    return {
        f'{node}:{name}': value
        for node, values in settings.items()
        for name, value in values.items()
    }
