"""A tool server for assistants (Model Context Protocol): they ask the memory, and act only as a person confirms."""
