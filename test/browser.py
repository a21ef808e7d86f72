"""Chromium without a display, where it is installed."""

import json
import shutil

import pytest

CHROMIUM, DRIVER = shutil.which('chromium'), shutil.which('chromedriver')


def started(width=1200, height=900):
    """A browser; the test is skipped where there is none. The caller quits it."""
    if not (CHROMIUM and DRIVER):
        pytest.skip('chromium and chromedriver are not installed')
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    size = f'window-size={width},{height}'
    for switch in ('headless=new', 'no-sandbox', 'disable-dev-shm-usage', size):
        options.add_argument(f'--{switch}')
    options.set_capability('goog:loggingPrefs', {'browser': 'ALL', 'performance': 'ALL'})
    driver = webdriver.Chrome(options, webdriver.ChromeService(DRIVER))
    driver.implicitly_wait(0)
    return driver


def requests(browser):
    """What it has asked for since the last call; not what it has in itself."""
    entries = [json.loads(entry['message'])['message'] for entry in browser.get_log('performance')]
    sent = [
        e['params']['request']['url']
        for e in entries
        if e['method'] == 'Network.requestWillBeSent'
    ]
    sent += [e['params']['url'] for e in entries if e['method'] == 'Network.webSocketCreated']
    return [url for url in sent if not url.startswith(('data:', 'blob:'))]
