"""Bags of ROS: recordings exported as bags, and bags of others as recordings and as cameras."""
