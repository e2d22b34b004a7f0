"""Tools for the wire, for developers: to record, decode, replay, and disturb it. No robot needs them.

    capture/  recordings in the formats of other tools: decoded, filtered, replayed; the gauges of a link
    conform/  the rules for controllers, tried on a real one: `robotree conform`
    relay/    a relay that loses, delays and repeats frames of a running link

`robotree wire …` runs them. The rest of `robotree.protocol`, `sim` and `proxy` do not import them.
"""
