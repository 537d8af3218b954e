"""How time and memory grow with the numbers of agents, cells, stored runs and workers."""
