# SPDX-License-Identifier: Apache-2.0
"""A headless Chromium for tests of web pages."""

from contextlib import contextmanager
import os
from pathlib import Path
import time

from left_out import program

LIMIT_S = 240.0
FLAGS = ('--headless=new', '--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run',
         '--disable-background-networking', '--disable-component-update', '--disable-sync',
         '--disable-dev-shm-usage', '--js-flags=--expose-gc', '--enable-precise-memory-info',
         # Names for this computer that are not those of a loopback address.
         '--host-resolver-rules=MAP *.test 127.0.0.1')
# Pictures for the documentation go here if the variable is set: BEV_PREHEAT_PICTURES=docs/pictures
PICTURES = os.environ.get('BEV_PREHEAT_PICTURES')
DESKTOP, PHONE = (1180, 900), (390, 844)


class Browser:
    """One window; `messages` are the errors and warnings of its console so far."""

    def __init__(self, driver):
        self._driver, self.messages = driver, []

    def open(self, url):
        self._driver.get(url)

    def forget_cookies(self):
        self._driver.execute_cdp_cmd('Network.clearBrowserCookies', {})

    def run(self, script, *arguments):
        return self._driver.execute_script(script, *arguments)

    def texts(self, *ids):
        """Return the texts of elements, '' if they are hidden."""
        return self.run('return arguments[0].map((id) => document.getElementById(id).innerText)', list(ids))

    def text(self, name):
        return self.texts(name)[0]

    def is_visible(self, name):
        """Return whether an element is there and has a size."""
        return self.run('const e = document.getElementById(arguments[0]);'
                        'return !!e && e.getClientRects().length > 0', name)

    def click(self, name):
        """Click as a person does: the element must be visible and reachable."""
        from selenium.webdriver.common.by import By
        self._driver.find_element(By.ID, name).click()

    def type(self, name, text):
        """Replace the text of an input field by typing."""
        from selenium.webdriver.common.by import By
        field = self._driver.find_element(By.ID, name)
        field.clear()
        field.send_keys(text)

    def press(self, *keys):
        from selenium.webdriver.common.keys import Keys
        self._driver.switch_to.active_element.send_keys(*(getattr(Keys, key, key) for key in keys))

    def wait(self, condition, what, limit_s=90.0):
        """Return the first truthy condition()."""
        end_s = time.monotonic() + limit_s
        while not (value := condition()):
            assert time.monotonic() < end_s, (
                f'{what}: not within {limit_s:g} s; the page: {self.page_text()[:1500]}')
            time.sleep(0.1)
        return value

    def page_text(self):
        return self.run('return document.body.innerText')

    def size(self, width, height, dark=False):
        self._driver.execute_cdp_cmd('Emulation.setDeviceMetricsOverride', {
            'width': width, 'height': height, 'deviceScaleFactor': 1, 'mobile': width < 600})
        self._driver.execute_cdp_cmd('Emulation.setEmulatedMedia', {'features': [
            {'name': 'prefers-color-scheme', 'value': 'dark' if dark else 'light'}]})

    def overflow_px(self):
        """Return by how much the page is wider than the window."""
        return self.run('return document.documentElement.scrollWidth - document.documentElement.clientWidth')

    def heap_mb(self):
        """Return the memory of the page's scripts after garbage collection."""
        self.run('gc(); gc()')
        return self.run('return performance.memory.usedJSHeapSize') / 2**20

    def picture(self, name, width, height):
        """Write the page as PNG into the folder of pictures, if there is one."""
        if not PICTURES:
            return
        self.size(width, height)
        full = min(self.run('return document.documentElement.scrollHeight'), 2400)
        self.size(width, full)
        time.sleep(1.0)
        Path(PICTURES, name).write_bytes(self._driver.get_screenshot_as_png())
        self.size(*DESKTOP)

    def new_messages(self):
        """Return the console's errors and warnings since the last call."""
        found = [f'{entry["level"]}: {entry["message"]}' for entry in self._driver.get_log('browser')
                 if entry['level'] in ('SEVERE', 'WARNING')]
        self.messages += found
        return found


@contextmanager
def browser(folder):
    """Give a Browser with a fresh profile inside the block."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service
    options = webdriver.ChromeOptions()
    for flag in (*FLAGS, f'--user-data-dir={folder}'):
        options.add_argument(flag)
    options.binary_location = program('chromium')
    options.set_capability('goog:loggingPrefs', {'browser': 'ALL'})
    driver = webdriver.Chrome(options=options, service=Service(program('chromedriver')))
    try:
        driver.set_page_load_timeout(LIMIT_S)
        made = Browser(driver)
        made.size(*DESKTOP)
        yield made
    finally:
        driver.quit()
