"""What pytest leaves out here: the web pages need gradio to be imported, and hold no examples."""

collect_ignore_glob = [
    *("space/*", "xden_bench/serve/page_*.py"),
    *("xden_bench/serve/app.py", "xden_bench/serve/told.py"),
]
