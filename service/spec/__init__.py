"""Specifications of campaigns: TOML or JSON in, validated and hashed data out, and the way back to text."""

from service.spec.spec import Spec, SpecError, load_spec, problem_without_files, spec_from

__all__ = ["Spec", "SpecError", "load_spec", "problem_without_files", "spec_from"]
