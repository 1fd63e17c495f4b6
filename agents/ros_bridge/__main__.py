"""`python -m agents.ros_bridge`"""

from agents.ros_bridge import RosBridge
from dsr import main

main(RosBridge)
