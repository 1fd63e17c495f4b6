"""What an arm is: links, joints, fingers and shapes, read off its description."""
