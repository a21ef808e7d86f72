"""Any machine of rigid bodies: a tree of joints, loops that close it, its motion and dynamics."""
