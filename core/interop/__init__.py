"""P_k in the shapes that other people's programs ask for; nothing here imports those programs."""

from core.interop.pygmo_problem import PygmoProblem

__all__ = ["PygmoProblem"]
