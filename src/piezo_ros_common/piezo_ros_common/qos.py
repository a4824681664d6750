"""Quality of service by meaning, in one place."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

# Every tick of a loop, none lost; a link that starts late gets the last ticks, so that a
# lock-step loop starts whatever the order in which its processes come up.
LOOP = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=64,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)

# For a node beside the loop that must see every tick though nobody waits for it.
FOLLOWER = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=20000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)

# The newest value of something that changes seldom, for whoever comes later.
LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)

# What a recorder or a plot listens with: as much as comes, never holding up the loop.
OBSERVER = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=10000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
