"""The report of a campaign: facts of its solves in, one HTML file and a folder of SVG, PNG and CSV out."""

from service.report.write import tables_as_json, write_report

__all__ = ["tables_as_json", "write_report"]
