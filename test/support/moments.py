"""Times, and levels of statuses, as tests of nodes write them."""

#: A second and the first moment, ns.
SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
OK, WARN, ERROR, STALE = b'\0', b'\1', b'\2', b'\3'
#: Longest time to wait for anything, s: far above what is normal, so that only a fault hits.
TIMEOUT_S = 60.0


def stamp_of(message):
    """Stamp of a message's header, ns."""
    return message.header.stamp.sec * SECOND + message.header.stamp.nanosec


def six_of(message):
    """Six numbers of a WrenchStamped, N and N m."""
    halves = message.wrench.force, message.wrench.torque
    return tuple(getattr(half, axis) for half in halves for axis in 'xyz')
