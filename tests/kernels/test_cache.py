"""Compiled code on disk is renewed when any kernel file changes."""

from cosserat_fem import kernels
from cosserat_fem.kernels.condense import assemble


def test_stamp_covers_every_kernel_file(tmp_path):
    """A change in one file must renew what was inlined from it into another."""
    assert assemble._cache._cache_file._source_stamp == kernels.STAMP
    assert len(kernels.STAMP) == 64
