"""`orip archive`: many projects, adjusted by the workers of Dask.

`run` finds the projects and hands them to the cluster; a worker asks the fork server beside it (`worker`,
`fork_server`) to adjust each in a process of its own (`task`), which writes what is kept of the project before it ends.
"""
