"""Tools for the wire, for developers: to record, decode, replay, disturb and measure it. No robot needs them.

    capture/  recordings in the formats of other tools: decoded, filtered, replayed; the gauges of a link
    relay/    a relay that loses, delays and repeats frames of a running link
    measure/  the figures that the wire promises, measured: `robotree wire bench`

`robotree wire …` runs them. The rest of `robotree.protocol`, `sim` and `proxy` do not import them.
"""
