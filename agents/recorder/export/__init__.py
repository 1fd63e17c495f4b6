"""Turns recordings into files of other formats: tables as CSV."""

from agents.recorder.export.csv_folder import Exported, export_csv
from agents.recorder.export.samples import ExportSelection
from agents.recorder.export.tables import TABLES, Table, TableColumn

__all__ = ["TABLES", "ExportSelection", "Exported", "Table", "TableColumn", "export_csv"]
