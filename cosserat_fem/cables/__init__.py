"""Which cable is that, and how stiff? Real cables, their layers, and both ends of their stiffness.

Rule: every number has a source and a status. Rooms: `buildup` makes stiffness of layers, `catalogue` knows cables,
`band` sets both ends of a stiffness side by side.
"""
