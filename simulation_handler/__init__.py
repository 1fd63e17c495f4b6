"""The belief simulator: a physics simulation kept in step with perception."""
