"""`coastarc bench`: options in, measurements of `workers` and `service.bench` as tables or JSON out."""

from service.cli.bench.command import bench

__all__ = ["bench"]
