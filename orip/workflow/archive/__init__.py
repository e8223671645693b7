"""`orip archive`: many projects, adjusted by the workers of Dask.

`run` finds the projects and hands them to the cluster; a worker asks the fork server beside it (`worker`,
`fork_server`), whose copies adjust one project after the other (`project_process`) and write what is kept of each
(`task`).
"""
