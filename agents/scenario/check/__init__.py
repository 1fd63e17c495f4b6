"""What is wrong or doubtful in a scenario file, and its true course without any agent."""
