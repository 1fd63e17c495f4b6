"""`dsr my_robot`: say how many boxes are in view."""

import typer

import dsr

app = typer.Typer(invoke_without_command=True)


@app.callback()
def my_robot(
    graph: str = typer.Option("my_robot", "--graph", "-g", envvar="DSR_GRAPH", help="Which graph."),
) -> None:
    """Say how many boxes are in view."""
    with dsr.connect(graph, agent="my_robot_command", must_exist=True) as memory:
        table = memory.get_node("table")
        typer.echo("there is no table" if table is None else f"{table.get('seen', 0)} boxes in view")
