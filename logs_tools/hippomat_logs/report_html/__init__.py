"""`hippomat-logs report`: one HTML file that shows a fleet's run, offline.

    logs.py      which files are one run of one fleet, and what is wrong with them
    reading.py   records of one robot -> RobotView, on the robot's own clock
    data.py      the values that are shown
    building.py, assembly.py  all logs -> ReportData, on the fleet's common time
    map_figure.py, time_figures.py, matrices.py   ReportData -> Bokeh
    page.py, page.html, page.css, playback.js   all of it as one file

(report.py beside this package is what a replay found.)
"""
