"""Times, and levels of statuses, as tests of nodes write them."""

#: A second and the first moment, ns.
SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
OK, WARN, ERROR, STALE = b'\0', b'\1', b'\2', b'\3'
#: Longest time to wait for anything, s: far above what is normal, so that only a fault hits.
TIMEOUT_S = 60.0
